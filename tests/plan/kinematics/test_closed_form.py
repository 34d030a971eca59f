"""Where the closed form says no: arms of another kind, and poses further or nearer than the links reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.model import Robot, load_robot
from arm.se3 import Array, transform
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches, has_closed_form
from plan.kinematics.ik import explain_pose, inverse_kinematics
from plan.kinematics.product_of_exponentials import product_of_exponentials

SHOULDER = (0.0, 0.0, 0.3052)
UPPER_ARM, FOREARM = 0.3048, 0.3302  # m, as in urdf/a465


def skewed(folder: Path, angle: float) -> Robot:
    """The A465 with joint 3 turned about the upper arm, so that it is not parallel to joint 2."""
    text = data_file("urdf/a465/a465.urdf").read_text()
    elbow = 'xyz="0.3048 0 0" rpy="0 0 -1.5707963267948966"'
    assert text.count(elbow) == 1
    path = folder / "arm.urdf"
    path.write_text(text.replace(elbow, f'xyz="0.3048 0 0" rpy="{angle} 0 -1.5707963267948966"'))
    return load_robot(path, "flange", transform(t=(0.0, 0.0, 0.1)), {"jaw_l": 0.0, "jaw_r": 0.0})


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_arms_whose_axes_2_and_3_are_skew_are_refused(tmp_path: Path, sign: float) -> None:
    """Beyond 10 mrad, which Newton's steps are sure to bridge."""
    robot = skewed(tmp_path, sign * 0.012)
    assert not has_closed_form(robot)
    with pytest.raises(
        InputError,
        match=r"parallel axes 2, 3: .* axes 2, 3 differ by 0.688 deg \(at most 10 mm, 0.57 deg\)",
    ) as caught:
        all_branches(robot, np.eye(4))
    assert caught.value.data["skewness"] == pytest.approx(0.012, rel=1e-3)
    assert caught.value.data["wrist_miss"] < 1e-9


def test_arms_whose_axes_are_nearly_parallel_are_solved(tmp_path: Path, unit: Unit) -> None:
    robot = skewed(tmp_path, 0.008)
    assert has_closed_form(robot)
    q = np.array([0.3, -0.5, -0.9, 0.4, 0.6, 0.2])
    T = robot.T_base_tool(q)
    found = inverse_kinematics(robot, T, unit.lower, unit.upper).q
    assert np.abs(found - q).max(axis=1).min() < 1e-9
    assert np.abs(product_of_exponentials(robot).tool_poses(found) - T).max() < 1e-9


def with_wrist_at(robot: Robot, distance: float, towards: tuple[float, float, float]) -> Array:
    """A tool pose whose wrist centre is so far from the shoulder, in that direction."""
    q = [0.2, -0.6, -0.8, 0.3, 0.7, 0.1]
    T = robot.T_base_tool(q).copy()
    place = np.array(SHOULDER) + distance * np.array(towards) / np.linalg.norm(towards)
    T[:3, 3] += place - robot.joint_poses(q)[5][:3, 3]
    return T


@pytest.mark.parametrize("towards", [(1.0, 0.0, 0.0), (0.6, 0.5, 0.7), (-0.3, 0.8, -0.2)])
@pytest.mark.parametrize(
    ("distance", "outside"),
    [
        (0.012, FOREARM - UPPER_ARM - 0.012),
        (FOREARM - UPPER_ARM - 0.001, 0.001),
        (UPPER_ARM + FOREARM + 0.03, 0.03),
    ],
)
def test_poses_nearer_or_further_than_the_links_reach_say_by_how_much(
    robot: Robot, unit: Unit, towards: tuple[float, float, float], distance: float, outside: float
) -> None:
    """The forearm is 25.4 mm longer than the upper arm: folded, the wrist comes no nearer to the shoulder."""
    T = with_wrist_at(robot, distance, towards)
    raw = all_branches(robot, T)
    assert not raw.reached.any()
    np.testing.assert_allclose(raw.outside[0], outside, atol=1e-9)
    assert not len(inverse_kinematics(robot, T, unit.lower, unit.upper))
    reports = explain_pose(robot, T, unit.lower, unit.upper)
    assert [r.branch for r in reports] == list(BRANCH_NAMES)
    np.testing.assert_allclose([r.outside for r in reports], outside, atol=1e-9)


@pytest.mark.parametrize("distance", [FOREARM - UPPER_ARM + 0.001, UPPER_ARM + FOREARM - 0.001])
def test_poses_just_inside_of_what_the_links_reach_are_reached(robot: Robot, distance: float) -> None:
    raw = all_branches(robot, with_wrist_at(robot, distance, (0.6, 0.5, 0.7)))
    assert raw.reached.all()
    assert not raw.outside.any()
