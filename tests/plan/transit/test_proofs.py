"""Proof of paths: what samples missed is found, and avoided by another way-point."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Limits
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.transit.edges import SampledEdges
from plan.transit.proofs import PathProof
from plans.transits import LIMITS, RIGHT, ROBOT, world_with

# a turn of the first joint by 40 deg, past a thin rod that the hand's corner grazes half way
AWAY = RIGHT + np.radians([40.0, 0.0, 0.0, 0.0, 0.0, 0.0])
HALF = ROBOT.T_base_tool((RIGHT + AWAY) / 2)[:3, 3]
ROD = Body("rod", Box((0.004, 0.004, 0.2)), transform(t=HALF - (0.0, 0.0, 0.099)), "post")


@pytest.mark.parametrize("seed", range(3))
def test_what_samples_miss_gets_another_way_point(seed: int) -> None:
    world, path = world_with(ROD), np.stack([RIGHT, AWAY])
    fine = SampledEdges(world.too_near(0.005), 0.02)
    assert not fine.clear(RIGHT, AWAY)
    mended = PathProof(world, LIMITS, 0.005, fine, np.random.default_rng(seed)).mended(path)
    assert mended is not None
    assert len(mended) > 2
    assert np.array_equal(mended[[0, -1]], path)
    assert certify_curve(world, curve_of_waypoints(mended), 0.005).proved


def test_every_new_edge_is_proved_and_within_limits() -> None:
    """Coarse samples miss the rod again and again; joints 1, 4, 5 and 6 have hardly any room."""
    world, path = world_with(ROD), np.stack([RIGHT, AWAY])
    room = np.array([0.001, 1.0, 1.0, 0.001, 0.001, 0.001])
    lower, upper = np.minimum(RIGHT, AWAY) - room, np.maximum(RIGHT, AWAY) + room
    limits, found = Limits(lower, upper, LIMITS.velocity, LIMITS.acceleration), 0
    for seed in range(30):
        coarse = SampledEdges(world.too_near(0.005), 2.0)
        mended = PathProof(world, limits, 0.005, coarse, np.random.default_rng(seed)).mended(path)
        if mended is not None:
            found += 1
            assert certify_curve(world, curve_of_waypoints(mended), 0.005).proved
            assert ((mended >= limits.lower) & (mended <= limits.upper)).all()
    assert found >= 5


def test_a_proved_path_stays_as_it_is() -> None:
    world, path = world_with(), np.stack([RIGHT, (RIGHT + AWAY) / 2, AWAY])
    proof = PathProof(
        world, LIMITS, 0.005, SampledEdges(world.too_near(0.005), 0.05), np.random.default_rng(0)
    )
    assert proof.mended(path) is path


def test_an_edge_that_nothing_near_replaces_stays_open() -> None:
    wall = Body("wall", Box((0.002, 2.0, 2.0)), transform(t=(HALF[0], HALF[1], 1.01)), "wall")
    world, path = world_with(wall), np.stack([RIGHT, AWAY])
    proof = PathProof(
        world, LIMITS, 0.005, SampledEdges(world.too_near(0.005), 0.05), np.random.default_rng(0)
    )
    assert proof.mended(path) is None
