"""Straight joint lines: clear at samples, or where they are blocked."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Cylinder
from arm.se3 import transform
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.transit.straight import check_straight
from plans.transits import LEFT, LOW_WALL, RIGHT, ROBOT, world_with

ASKED = 0.01


def test_a_clear_line_has_a_margin() -> None:
    found = check_straight(world_with(), RIGHT, LEFT, ASKED)
    assert found.clear
    assert found.end is None
    assert found.clearance > ASKED
    assert certify_curve(world_with(), curve_of_waypoints([RIGHT, LEFT]), found.clearance).proved


def test_a_thin_body_between_the_first_samples_is_met() -> None:
    """Wherever on the motion: samples are dense."""
    met = 0
    for u in np.linspace(0.06, 0.94, 23):
        tool = ROBOT.T_base_tool(RIGHT + u * (LEFT - RIGHT))[:3, 3]
        rod = Body("rod", Cylinder(0.002, 0.1), transform(t=tool), "post")
        found = check_straight(world_with(rod), RIGHT, LEFT, ASKED)
        assert not found.clear
        assert world_with(rod).in_collision(RIGHT + found.at * (LEFT - RIGHT), found.clearance)
        met += "rod" in found.seen(world_with(rod)).pair
    assert met == 23


def test_a_blocked_line_says_where_and_by_what() -> None:
    world = world_with(LOW_WALL)
    found = check_straight(world, RIGHT, LEFT, ASKED)
    seen = found.seen(world)
    assert not found.clear
    assert found.end is None
    assert "wall" in seen.pair
    assert seen.seen == world.distance(RIGHT + found.at * (LEFT - RIGHT)).value < found.clearance


@pytest.mark.parametrize("end", ["from", "to"])
def test_an_end_needs_only_the_asked_clearance(end: str) -> None:
    world = world_with()
    low = LEFT - np.radians([0.0, 15.0, 0.0, 0.0, 0.0, 0.0])
    has = world.distance(low).value
    assert world.distance(RIGHT).value > has + 0.01
    a, b = (low, RIGHT) if end == "from" else (RIGHT, low)
    too_much = check_straight(world, a, b, has + 1e-6)
    assert too_much.end == end
    assert too_much.at == (0.0 if end == "from" else 1.0)
    assert not too_much.clear
    enough = check_straight(world, a, b, has - 1e-6)
    assert enough.end is None
    assert has - 1e-6 <= enough.clearance < has


def test_a_line_that_goes_nowhere_is_clear() -> None:
    assert check_straight(world_with(), RIGHT, np.array(RIGHT), ASKED).clear
