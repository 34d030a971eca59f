"""Solutions for the poses of a list, or why there are none."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import transform
from plan.program.goals.target import Target
from plans.waypoints import refusal_of
from tasks.pose_lists import TABLE, down


def test_refusals_say_what_and_how_much(robot: Robot, crs97: Unit) -> None:
    far = refusal_of(robot, crs97, [TABLE], Target("far", down(1.2, 0.0, 0.3)))
    assert "target 'far' at (1200, 0, 300) mm is out of reach" in str(far)
    assert far.data["outside_m"] > 0.1

    low = refusal_of(robot, crs97, [TABLE], Target("low", down(0.45, 0.1, -0.055), free="rz"))
    assert "all" in str(low)
    assert "finger_" in str(low)
    assert low.data["pair"][1] == "table"
    assert low.data["distance_m"] < 0.0

    close = refusal_of(robot, crs97, [TABLE], Target("close", down(0.45, 0.1, -0.036), approach=0.05))
    assert close.data["target"] == "close"

    out = refusal_of(
        robot, crs97, [TABLE], Target("a", down(0.45, 0.1, 0.2)), Target("b", down(0.95, 0.1, 0.2), by="line")
    )
    assert "cannot be followed from any of" in str(out)
    assert "line at 'b'" in str(out)
    assert out.data["done_m"] > 0.05

    cage = [TABLE, Body("cage", Box((0.9, 0.02, 1.0)), transform(t=(0.58, 0.0, 0.45)), "wall")]
    cage.append(Body("back", Box((0.9, 0.02, 1.0)), transform(t=(-0.58, 0.0, 0.45)), "wall"))
    cage.append(Body("lid", Box((2.0, 2.0, 0.02)), transform(t=(0.0, 0.0, 0.7)), "wall"))
    at = robot.T_base_tool(np.radians([-60, -35, -85, 0, -60, 0]))
    pressed = refusal_of(
        robot, crs97, [Body("ball", Sphere(0.02), at, "post")], Target("a", down(0.3, 0.35, 0.2))
    )
    assert "q_start: palm is" in str(pressed)
    assert pressed.data["pair"][1] == "ball"
    stuck = refusal_of(robot, crs97, cage, Target("other side", down(0.3, 0.35, 0.2)))
    assert "no path to other side" in str(stuck)
    assert stuck.data["pair"][1] in ("cage", "back", "lid")
    assert sum(stuck.data["refused"].values()) >= 1


def test_a_configuration_that_is_too_near_is_told_as_such(robot: Robot, crs97: Unit) -> None:
    """No pose of it can be turned, and it has no approach."""
    q = np.radians([0.0, -80.0, -80.0, 0.0, -20.0, 0.0])
    low = refusal_of(robot, crs97, [TABLE], Target("low", q=q))
    assert "target 'low': the configuration is too near to a body: " in str(low)
    assert str(low).endswith("choose another one")
