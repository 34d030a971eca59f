"""Extra clearance during the search, because time parametrisation and rounding still change the path."""

from __future__ import annotations

from collections.abc import Iterable

from arm.se3 import Array
from plan.collision.world import World

MARGIN = 1e-3  # m, for transits
LINE_MARGIN = 1e-4  # m, for lines, which keep their shape


def searched_clearance(world: World, ends: Iterable[Array], asked: float, margin: float = MARGIN) -> float:
    """Return the clearance to search a path with, m: the required one plus a margin.

    The ends of the path are fixed and need only the required clearance. If an end lacks the margin, the margin shrinks
    to half of what that end has beyond the required clearance.

    Args:
        world: world of the path.
        ends: configurations (n,) rad.
        asked: required clearance, m.
        margin: m.
    """
    for q in ends:
        if world.in_collision(q, asked + margin):
            margin = min(margin, max((world.distance(q).value - asked) / 2.0, 0.0))
    return asked + margin
