"""What is carried along a list of poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Sphere
from arm.se3 import transform
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.target import Target
from plan.program.planned import Pause
from plan.scene import Scene
from plans.waypoints import planned
from tasks.pose_lists import TABLE, down


def test_what_is_carried_stands_where_it_was_brought(robot: Robot) -> None:
    cup = Body("cup", Sphere(0.02), transform(t=(0.4, -0.2, 0.1)), "cube")
    pick = Target("pick", down(0.4, -0.2, 0.12), attach="cup")
    place = Target("place", down(0.4, 0.2, 0.22), detach=True)
    worlds = AttachmentWorlds(Scene(robot, robot, (TABLE,), (cup,)), [pick, place])
    held = worlds.after(worlds.start, pick, pick.T_base_tool)
    assert held.held == "cup"
    np.testing.assert_allclose(held.T_tool_held[:3, 3], (0.0, 0.0, 0.02), atol=1e-12)
    brought = worlds.after(held, place, place.T_base_tool)
    assert brought.held is None
    np.testing.assert_allclose(dict(brought.moved)["cup"][:3, 3], (0.4, 0.2, 0.2), atol=1e-12)
    assert len({worlds.start.key, held.key, brought.key}) == 3


def test_a_body_is_attached_only_between_the_jaws(robot: Robot, crs97: Unit) -> None:
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(-0.2, 0.5, 0.015)), "cube")
    pick = Target(
        "pick",
        down(0.45, 0.1, 0.1),
        attach="box",
        allowed_collisions={("finger_l", "box"), ("finger_r", "box")},
    )
    with pytest.raises(ImpossibleError) as caught:
        planned(robot, crs97, [TABLE, box], pick)
    gap = caught.value.data["distance_m"]
    assert 0.6 < gap < 0.8
    assert f"'pick': attach = 'box': is {gap * 1e3:.1f} mm from" in str(caught.value)
    assert "at most 10 mm" in str(caught.value)
    assert "attach_within" in str(caught.value)
    assert caught.value.data["pair"][1] == "box"
    # a rule of the list's own
    taken = planned(robot, crs97, [TABLE, box], replace(pick, attach_within=0.8))
    assert [step.attached for step in taken.steps if isinstance(step, Pause)] == ["box"]


def test_a_body_that_was_brought_elsewhere_is_looked_for_there(robot: Robot, crs97: Unit) -> None:
    touching = {("finger_l", "box"), ("finger_r", "box"), ("palm", "box"), ("table", "box")}
    place = down(0.4, 0.15, 0.06)
    box = Body("box", Box((0.03, 0.03, 0.03)), transform(t=(0.4, 0.15, 0.06)), "cube")
    lines = {"approach": 0.05, "retract": 0.05, "allowed_collisions": touching}
    targets = [
        Target("pick", place, attach="box", **lines),
        Target("put", down(0.4, -0.15, 0.06), detach=True, **lines),
    ]
    again = Target("pick again", place, attach="box", **lines)
    assert planned(robot, crs97, [TABLE, box], *targets).moves
    with pytest.raises(
        ImpossibleError, match=r"'pick again': attach = 'box': is 2\d\d\.\d mm from"
    ) as caught:
        planned(robot, crs97, [TABLE, box], *targets, again)
    assert 0.2 < caught.value.data["distance_m"] < 0.3
