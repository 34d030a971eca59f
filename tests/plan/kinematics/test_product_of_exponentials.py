"""The batched kinematics against Pinocchio's."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.robot.model import Robot, load_robot
from arm.se3 import transform
from plan.kinematics.product_of_exponentials import product_of_exponentials


def test_poses_and_jacobians_are_those_of_the_robot(robot: Robot) -> None:
    q = np.random.default_rng(1).uniform(-3.0, 3.0, (200, 6))
    arm = product_of_exponentials(robot)
    poses, jacobians = arm.tool_poses(q), arm.jacobians(q)
    for k in range(len(q)):
        np.testing.assert_allclose(poses[k], robot.T_base_tool(q[k]), atol=1e-14)
        in_tool_axes = np.kron(np.eye(2), poses[k, :3, :3].T) @ jacobians[k]
        np.testing.assert_allclose(in_tool_axes, robot.jacobian(q[k]), atol=1e-13)


def test_any_leading_shape(robot: Robot) -> None:
    q = np.random.default_rng(2).uniform(-3.0, 3.0, (3, 5, 6))
    arm = product_of_exponentials(robot)
    np.testing.assert_array_equal(arm.tool_poses(q)[2, 4], arm.tool_poses(q[2, 4]))
    np.testing.assert_allclose(arm.jacobians(q)[1, 3], arm.jacobians(q[1, 3]), atol=1e-15)


_SLIDER = """
<robot name="slider">
  <link name="base"/> <link name="a"/> <link name="b"/> <link name="c"/>
  <joint name="turn" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0.1 0 0.2" rpy="0.3 0.1 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><origin xyz="0 0.1 0.1" rpy="0.5 0 0"/>
    <axis xyz="0 0.6 0.8"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>
  <joint name="tip" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.2 0 0.1" rpy="0 0.4 1"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" velocity="1" effort="1"/></joint>
</robot>
"""


def test_a_sliding_joint_is_followed_too(tmp_path: Path) -> None:
    (tmp_path / "slider.urdf").write_text(_SLIDER)
    robot = load_robot(tmp_path / "slider.urdf", "c", transform(t=(0.05, 0.1, 0.02)))
    arm = product_of_exponentials(robot)
    q = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 3))
    poses, jacobians = arm.tool_poses(q), arm.jacobians(q)
    for k in range(len(q)):
        np.testing.assert_allclose(poses[k], robot.T_base_tool(q[k]), atol=1e-14)
        in_tool_axes = np.kron(np.eye(2), poses[k, :3, :3].T) @ jacobians[k]
        np.testing.assert_allclose(in_tool_axes, robot.jacobian(q[k]), atol=1e-13)
