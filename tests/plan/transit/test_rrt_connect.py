"""RRT-Connect alone."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import load_unit
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from plan.budget import TransitBudget
from plan.collision.bezier import curve_of_waypoints
from plan.collision.certificate import certify_curve
from plan.transit.planner import plan_transit
from plans.transits import world_with
from tasks.task2 import Q_START

UNIT = load_unit("crs93")

LIMITS = UNIT.limits().scaled(0.5)

RIGHT = np.array(Q_START)

LEFT = RIGHT * np.array([-1.0, 1.0, 1.0, 1.0, 1.0, 1.0])

# across the straight way, lower than the arm can go over
LOW_WALL = Body("wall", Box((0.3, 0.02, 0.3)), transform(t=(0.45, 0.0, 0.15)), "wall")


def test_rrt_connect_alone_finds_a_path() -> None:
    world = world_with(LOW_WALL)
    way = plan_transit(world, RIGHT, LEFT, LIMITS, 0.011, 0, TransitBudget(corner_edges=0))
    assert np.array_equal(way[0], RIGHT)
    assert np.array_equal(way[-1], LEFT)
    assert certify_curve(world, curve_of_waypoints(way), 0.011).proved
