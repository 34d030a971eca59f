"""Room that ways are searched with beyond the clearance that is asked, for what timing and rounding change."""

from __future__ import annotations

from collections.abc import Iterable

from arm.se3 import Array
from plan.collision.world import World

MARGIN = 1e-3  # m, of ways across


def searched_clearance(world: World, ends: Iterable[Array], asked: float, margin: float = MARGIN) -> float:
    """The asked clearance and a margin, or half of what the ends leave of it, m.

    The ends of a way are where the arm stands or has to go: only the asked clearance is asked of them.

    Args:
        world: that the way is in.
        ends: configurations (n,) rad.
        asked: m.
        margin: m.
    """
    for q in ends:
        if world.in_collision(q, asked + margin):
            margin = min(margin, max((world.distance(q).value - asked) / 2.0, 0.0))
    return asked + margin
