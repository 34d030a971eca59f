"""Links of an arm that overlap in every configuration because no SRDF disables their collisions."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import numpy as np

from arm.robot.model import Robot
from arm.se3 import Array
from plan.collision.world import World

_SAMPLES = 20  # random configurations; links that overlap in all of them count as always overlapping
_SHOWN = 6


def self_collisions(world: World, q: Array, clearance: float) -> tuple[tuple[str, str], ...]:
    """Return pairs of links too near at q (n,) that need a disabled collision: neighbours, or always overlapping.

    Args:
        world: world of the arm.
        q: rad (m for prismatic joints).
        clearance: required clearance, m.
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


def self_collision_help(world: World, q: Array, clearance: float) -> str:
    """Return advice on `self_collisions` to append to an error message; "" if there are none."""
    pairs = self_collisions(world, q, clearance)
    if not pairs:
        return ""
    listed = ", ".join(f"{a} / {b}" for a, b in pairs[:_SHOWN])
    listed += f" and {len(pairs) - _SHOWN} more" if len(pairs) > _SHOWN else ""
    a, b = pairs[0]
    return (
        f'; the arm needs its SRDF (srdf=, or beside the URDF) with <disable_collisions link1="{a}" link2="{b}" '
        f'reason="Adjacent"/> and so on, or neighbours_may_touch in its arm file, or '
        f"`arm.robot.tool.with_disabled_collisions`, "
        f"for links that are always near each other: {listed}"
    )


@lru_cache(maxsize=8)
def _everywhere(robot: Robot) -> frozenset[frozenset[str]]:
    """Return pairs of the arm's bodies that overlap at every one of `_SAMPLES` random configurations."""
    world = World(robot, [])
    low = np.maximum(np.asarray(robot.model.lowerPositionLimit), -np.pi)
    high = np.minimum(np.asarray(robot.model.upperPositionLimit), np.pi)
    every = np.arange(len(world.pairs))
    left = np.ones(len(every), dtype=bool)
    for q in np.random.default_rng(0).uniform(low, high, (_SAMPLES, len(low))):
        left[left] = world.pair_distances(q, every[left]) <= 0.0
    return frozenset(frozenset(world.pair_names(i)) for i in np.flatnonzero(left).tolist())
