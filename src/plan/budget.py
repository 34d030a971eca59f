"""Budgets of searches, counted in tries and never in seconds; light to import."""

from __future__ import annotations

from dataclasses import dataclass, fields

from arm.given import integer


@dataclass(frozen=True)
class TransitBudget:
    """Tries of each stage. Costs are about 0.01 ms for a corner that is refused by itself, 0.5 ms for an edge.

    Attributes:
        corners: single corners drawn at random, besides those from lifting the tool.
        corner_edges: corners, the fastest first, that are clear themselves and whose edges are looked at.
        rrt: samples of RRT-Connect.
        shortcuts: tries to cut corners of what RRT-Connect found.
        starts: ways with few corners that are made faster; the fastest is taken.
        more_starts: further ones, where that is still much slower than the straight way.
        steps: of sequential quadratic programming, for the fastest; the others have a third.

    Raises:
        InputError: one of them is not a whole number from 0 on.
    """

    corners: int = 300
    corner_edges: int = 90
    rrt: int = 3000
    shortcuts: int = 40
    starts: int = 2
    more_starts: int = 4
    steps: int = 6

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(
                self, field.name, integer(f"transit.{field.name}", getattr(self, field.name), 0)
            )
