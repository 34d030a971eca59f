"""The configuration that comes nearest to a pose: it reaches what can be reached, and no other is nearer."""

from __future__ import annotations

import json

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.se3 import rot_x, rot_y, transform
from plan.kinematics.freedom import Freedom
from plan.kinematics.nearest import AskedPose, asked_pose_from_json, nearest_configuration
from plan.kinematics.product_of_exponentials import product_of_exponentials

LEVER = 0.5  # m for each rad, by which poses are compared


@pytest.mark.parametrize("seed", range(3))
def test_a_pose_that_can_be_reached_is_reached(robot: Robot, unit: Unit, seed: int) -> None:
    q = np.random.default_rng(seed).uniform(unit.lower, unit.upper)
    found = nearest_configuration(robot, AskedPose(robot.T_base_tool(q)), unit.lower, unit.upper)
    assert found.away < 1e-5
    assert found.turned < 1e-4
    assert (found.q >= unit.lower).all()
    assert (found.q <= unit.upper).all()


@pytest.mark.parametrize("seed", range(3))
def test_of_a_pose_out_of_reach_no_configuration_is_nearer(robot: Robot, unit: Unit, seed: int) -> None:
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-2.0, 2.0)
    place = (1.1 * np.cos(azimuth), 1.1 * np.sin(azimuth), rng.uniform(0.1, 0.5))
    pose = AskedPose(transform(rot_x(np.pi), place))
    found = nearest_configuration(robot, pose, unit.lower, unit.upper)
    assert found.away > 0.05
    away, turned = pose.freedom.excess(pose.T_base_tool, robot.T_base_tool(found.q))
    assert (found.away, found.turned) == (pytest.approx(float(away)), pytest.approx(float(turned)))
    others = product_of_exponentials(robot).tool_poses(rng.uniform(unit.lower, unit.upper, (20_000, 6)))
    away, turned = pose.freedom.excess(pose.T_base_tool, others)
    assert np.hypot(found.away, LEVER * found.turned) < np.hypot(away, LEVER * turned).min()


def test_what_is_free_is_no_miss(robot: Robot, unit: Unit) -> None:
    q = np.radians([10.0, -20.0, -60.0, 20.0, -50.0, 30.0])
    T = robot.T_base_tool(q) @ transform(rot_y(0.3), (0.0, 0.0, 0.02))
    tilted = AskedPose(T, Freedom({"z": (-0.03, 0.0)}, 0.4), ("rz",))
    again = asked_pose_from_json(json.loads(json.dumps(tilted.to_json())))
    assert again.to_json() == tilted.to_json()
    away, turned = again.freedom.excess(T, robot.T_base_tool(q), again.free)
    assert float(away) < 0.01
    assert float(turned) == 0.0
    found = nearest_configuration(robot, again, unit.lower, unit.upper, [q])
    assert found.away < 1e-5
    assert found.turned < 1e-4
