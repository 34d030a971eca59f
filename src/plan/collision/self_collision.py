"""Links of an arm that overlap by themselves, as they do where no SRDF says which pairs are not to be checked."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from arm.robot.model import Robot
from arm.se3 import Array
from plan.collision.world import World

_LOOKS = 20  # configurations within the arm's range; what overlaps in all of them always does
_SHOWN = 6


def own_overlaps(world: World, q: Array, clearance: float) -> tuple[tuple[str, str], ...]:
    """Pairs of links too near at q (n,) that nobody could plan with: neighbours, and such as overlap everywhere.

    Args:
        world: of the arm.
        q: rad (m for sliding joints).
        clearance: asked for, m.
    """
    robot = world.robot
    link = {b.name: b.link or b.name for b in robot.bodies}
    near = {d.pair for d in world.distances_below(q, clearance) if set(d.pair) <= set(link)}
    bearing = sorted({b.joint for b in robot.bodies})
    neighbours = set(pairwise(bearing))
    found = {
        (link[b], link[a])
        for a, b in near
        if (world.joint_of(b), world.joint_of(a)) in neighbours or frozenset((a, b)) in _everywhere(robot)
    }
    order = {name: i for i, name in enumerate(dict.fromkeys(link.values()))}
    return tuple(sorted(found, key=lambda pair: (order[pair[0]], order[pair[1]])))


def told_own_overlaps(world: World, q: Array, clearance: float) -> str:
    """What to do about them, to be put behind a refusal; "" where there are none."""
    pairs = own_overlaps(world, q, clearance)
    if not pairs:
        return ""
    listed = ", ".join(f"{a} / {b}" for a, b in pairs[:_SHOWN]) + (
        f" and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else ""
    )
    a, b = pairs[0]
    return (
        f'; the arm needs its SRDF (srdf=, or beside the URDF) with <disable_collisions link1="{a}" link2="{b}" '
        f'reason="Adjacent"/> and so on, or `arm.robot.tool.ignoring`, for links that are near by themselves: {listed}'
    )


@lru_cache(maxsize=8)
def _everywhere(robot: Robot) -> frozenset[frozenset[str]]:
    """Pairs of bodies of the arm that overlap at each of some configurations."""
    world = World(robot, [])
    low = np.maximum(np.asarray(robot.model.lowerPositionLimit), -np.pi)
    high = np.minimum(np.asarray(robot.model.upperPositionLimit), np.pi)
    every = np.arange(len(world.pairs))
    left = np.ones(len(every), dtype=bool)
    for q in np.random.default_rng(0).uniform(low, high, (_LOOKS, len(low))):
        left[left] = world.pair_distances(q, every[left]) <= 0.0
    return frozenset(frozenset(world.pair_names(i)) for i in np.flatnonzero(left).tolist())
