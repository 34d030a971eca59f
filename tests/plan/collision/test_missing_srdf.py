"""An arm without an SRDF whose links overlap where they meet: what is said, wherever such an arm is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.robot.model import Robot, load_robot
from arm.robot.shapes import Body, Sphere
from arm.robot.tool import urdf_limits, with_disabled_collisions
from arm.se3 import transform
from arms.made_up import SEVEN, arm, several_bodies, urdf
from plan.collision.missing_srdf import self_collision_help, self_collisions
from plan.collision.world import World
from plan.program.goals.target import Target
from plan.program.pose_lists import plan_poses
from plan.transit.planner import plan_transit

Q = np.array([0.1, 0.5, 0.1, 1.0, 0.1, 0.8, 0.1])
NEXT = [(f"l{k}", f"l{k + 1}") for k in range(7)]
# shoulder, elbow and wrist are two joints in a place: their links overlap over one that lies between
OVER_ONE = [("l0", "l2"), ("l2", "l4"), ("l4", "l6")]


def bare(folder: Path) -> Robot:
    """The arm of seven joints as a URDF alone, two bodies a link."""
    path = folder / "arm.urdf"
    path.write_text(several_bodies(urdf(SEVEN), 2))
    return load_robot(path, "l7", transform(t=(0.0, 0.0, 0.1)))


def test_always_overlapping_and_neighbouring_links_are_listed(tmp_path: Path) -> None:
    robot = bare(tmp_path)
    found = self_collisions(World(robot, []), Q, 0.005)
    assert set(found) == {*NEXT, *OVER_ONE}
    text = self_collision_help(World(robot, []), Q, 0.005)
    assert 'disable_collisions link1="l0" link2="l1" reason="Adjacent"' in text
    assert "l0 / l1, l0 / l2" in text
    assert "and 4 more" in text
    # what is said helps
    ready = with_disabled_collisions(robot, found)
    assert World(ready, []).distance(Q).value > 0.005
    assert self_collision_help(World(ready, []), Q, 0.005) == ""
    # a body that is near is no such pair, nor a link that only here comes near to another
    ball = Body("ball", Sphere(0.1), ready.T_base_tool(Q), "wall")
    assert self_collision_help(World(ready, [ball]), Q, 0.005) == ""
    folded = np.array([0.0, 0.0, 0.0, 2.3, 0.0, 2.6, 0.0])
    assert World(ready, []).distance(folded).value < 0.005
    assert self_collision_help(World(ready, []), folded, 0.005) == ""


def test_every_planner_advises_an_srdf(tmp_path: Path) -> None:
    robot = bare(tmp_path)
    limits = urdf_limits(robot, 5.0)
    target = Target("there", robot.T_base_tool(Q + 0.1))
    for refused in (
        lambda: plan_poses(robot, [], [target], Q, limits),
        lambda: plan_transit(World(robot, []), Q, Q + 0.2, limits, 0.005, 0),
    ):
        with pytest.raises(ImpossibleError, match='disable_collisions link1="l0" link2="l1"'):
            refused()


def test_no_srdf_advice_if_the_pairs_are_disabled(tmp_path: Path) -> None:
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    ball = Body("ball", Sphere(0.05), robot.T_base_tool(Q), "wall")
    with pytest.raises(ImpossibleError, match="start elsewhere, require less clearance") as caught:
        plan_poses(robot, [ball], [Target("there", robot.T_base_tool(Q + 0.1))], Q, urdf_limits(robot, 5.0))
    assert "disable_collisions" not in str(caught.value)


def test_neighbours_below_the_clearance_are_listed(tmp_path: Path) -> None:
    """They overlap nowhere: 3 mm lie between a turntable and its foot."""
    path = tmp_path / "table.urdf"
    box = '<collision><origin xyz="0 0 {}"/><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    path.write_text(
        f'<robot name="table"><link name="foot">{box.format(0.05)}</link><link name="top">{box.format(0.153)}</link>'
        '<joint name="turn" type="continuous"><parent link="foot"/><child link="top"/><axis xyz="0 0 1"/>'
        "</joint></robot>"
    )
    world = World(load_robot(path, "top", np.eye(4)), [])
    assert self_collisions(world, np.array([0.3]), 0.005) == (("foot", "top"),)
    assert self_collisions(world, np.array([0.3]), 0.002) == ()
