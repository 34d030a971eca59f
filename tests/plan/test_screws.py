"""The batched kinematics against Pinocchio's."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import InputError
from arm.robot import Robot, load_robot
from arm.se3 import transform
from plan.screws import screw_arm


def test_poses_and_jacobians_are_those_of_the_robot(robot: Robot) -> None:
    q = np.random.default_rng(1).uniform(-3.0, 3.0, (200, 6))
    arm = screw_arm(robot)
    poses, jacobians = arm.tool_poses(q), arm.jacobians(q)
    for k in range(len(q)):
        np.testing.assert_allclose(poses[k], robot.T_base_tool(q[k]), atol=1e-14)
        in_tool_axes = np.kron(np.eye(2), poses[k, :3, :3].T) @ jacobians[k]
        np.testing.assert_allclose(in_tool_axes, robot.jacobian(q[k]), atol=1e-13)


def test_any_leading_shape(robot: Robot) -> None:
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (3, 5, 6))
    arm = screw_arm(robot)
    np.testing.assert_array_equal(arm.tool_poses(q)[2, 4], arm.tool_poses(q[2, 4]))
    np.testing.assert_allclose(arm.jacobians(q)[1, 3], arm.jacobians(q[1, 3]), atol=1e-15)


def test_a_sliding_joint_is_refused(tmp_path) -> None:  # type: ignore[no-untyped-def]
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="slide" type="prismatic"><parent link="a"/>'
        '<child link="b"/><axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint></robot>'
    )
    with pytest.raises(InputError, match="slide is not a rotation"):
        screw_arm(load_robot(urdf, "b", transform()))
