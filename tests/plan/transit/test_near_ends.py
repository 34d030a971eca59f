"""Ends that have less than the asked clearance: left and come to with what they have, and told."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.transit.near_ends import leave_near_end
from plan.transit.planner import find_transit, plan_transit
from plans.transits import LEFT, LIMITS, LOW_WALL, RIGHT, ROBOT, world_with

ASKED = 0.011


def plate_below(gap: float) -> Body:
    """A plate `gap` m below the lowest point of the hand at `RIGHT`."""
    place = ROBOT.T_base_tool(RIGHT)[:3, 3]
    low = Body("plate", Box((0.2, 0.2, 0.01)), transform(t=(place[0], place[1], place[2] - 0.1)), "board")
    away = min(d.value for d in world_with(low).distances_below(RIGHT, 0.2) if "plate" in d.pair)
    raised = low.at(transform(t=(place[0], place[1], place[2] - 0.1 + away - gap)))
    assert min(d.value for d in world_with(raised).distances_below(RIGHT, 0.2)) == pytest.approx(
        gap, abs=2e-3
    )
    return raised


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("walls", [(), (LOW_WALL,)], ids=["free", "wall"])
def test_a_near_end_is_left_with_what_it_has(walls: tuple[Body, ...], seed: int) -> None:
    world = world_with(plate_below(0.003), *walls)
    has = world.distance(RIGHT).value
    assert 0.0 < has < ASKED
    for start, goal, end in ((RIGHT, LEFT, "from"), (LEFT, RIGHT, "to")):
        found = find_transit(world, start, goal, LIMITS, ASKED, seed)
        (near,) = found.near_ends
        assert (near.end, near.distance) == (end, has)
        assert "plate" in near.pair
        assert has - 2e-4 < near.clearance <= has
        assert np.array_equal(found.waypoints[[0, -1]], [start, goal])
        assert sorted(found.clearances)[:2] == [near.clearance, ASKED]
        assert found.clearances[0 if end == "from" else -1] == near.clearance
        for line, kept in zip(
            np.stack([found.waypoints[:-1], found.waypoints[1:]], axis=1), found.clearances, strict=True
        ):
            assert certify_curve(world, curve_of_waypoints(line), kept).proved


@pytest.mark.slow
def test_no_end_is_left_through_a_body() -> None:
    """Rods about the hand: beyond each there is room, and only a little of it on this side."""
    x, y, z = ROBOT.T_base_tool(RIGHT)[:3, 3]
    rods = [
        Body(
            f"rod {i}",
            Box((0.004, 0.004, 0.06)),
            transform(t=(x + 0.053 * np.cos(a), y + 0.053 * np.sin(a), z)),
            "post",
        )
        for i, a in enumerate(np.arange(0.0, 2.0 * np.pi, np.pi / 4))
    ]
    world, left = world_with(*rods), 0
    assert 0.0 < world.distance(RIGHT).value < ASKED
    for seed in range(20):
        near = leave_near_end(world, LIMITS, "from", RIGHT, ASKED, np.random.default_rng(seed))
        if near is not None:
            left += 1
            assert certify_curve(world, curve_of_waypoints([RIGHT, near.waypoint]), near.clearance).proved
            assert not world.in_collision(near.waypoint, ASKED)
    assert left >= 10


@pytest.mark.parametrize("seed", range(4))
def test_no_end_is_left_beyond_limits(seed: int) -> None:
    """Three joints stand near a limit, as after a stop beside it."""
    world, room = world_with(plate_below(0.003)), np.array([1.0, 0.002, 1.0, 0.002, 1.0, 0.002])
    limits = Limits(RIGHT - room, RIGHT + room[::-1], LIMITS.velocity, LIMITS.acceleration)
    near = leave_near_end(world, limits, "from", RIGHT, ASKED, np.random.default_rng(seed))
    assert near is not None
    assert ((near.waypoint >= limits.lower) & (near.waypoint <= limits.upper)).all()


def test_ends_with_the_clearance_are_as_ever() -> None:
    world = world_with(LOW_WALL)
    found = find_transit(world, RIGHT, LEFT, LIMITS, ASKED, 3)
    assert found.near_ends == ()
    assert set(found.clearances) == {ASKED}
    assert np.array_equal(found.waypoints, plan_transit(world, RIGHT, LEFT, LIMITS, ASKED, 3))


def test_an_end_that_touches_is_refused() -> None:
    for find, gap in ((find_transit, -0.001), (plan_transit, 0.003)):
        with pytest.raises(ImpossibleError, match="the start of the motion is itself too near"):
            find(world_with(plate_below(gap)), RIGHT, LEFT, LIMITS, ASKED, 0)
