"""Candidate corners of transits."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Limits
from plan.budget import TransitBudget
from plan.collision.world import World
from plan.transit.corners import FewCorners
from plan.transit.optimise import Ends
from plans.transits import LEFT, LIMITS, LOW_WALL, RIGHT, inside, near_limits, world_with


def corners_of(world: World, limits: Limits, seed: int) -> FewCorners:
    rng, still = np.random.default_rng(seed), np.zeros(6)
    return FewCorners(world.robot, limits, world.too_near(0.011), rng, TransitBudget(), Ends(still, still))


def test_corners_are_within_limits_that_are_near() -> None:
    """Of the corners that are tried, none takes a joint beyond its limits; none that does not is left out."""
    world, kept, left_out = world_with(LOW_WALL), 0, 0
    every = corners_of(world, LIMITS, 0).lifted(RIGHT, LEFT, 0.5)
    for seed in range(12):
        limits = near_limits(np.random.default_rng(seed))
        detours = corners_of(world, limits, seed)
        single, double = detours.lifted(RIGHT, LEFT, 0.5)
        drawn = detours.drawn(RIGHT, LEFT)
        assert inside(single, limits).all()
        assert inside(double, limits).all()
        assert inside(drawn[:, None], limits).all()
        assert len(np.unique(drawn, axis=0)) > 0.9 * TransitBudget().corners  # clipped, not all to one corner
        allowed = inside(every[0], limits)
        assert len(single) == allowed.sum()
        kept, left_out = kept + allowed.sum(), left_out + (~allowed).sum()
    assert kept > 50
    assert left_out > 50
