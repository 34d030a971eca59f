"""Inverse kinematics: properties against forward kinematics on random configurations."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.robot.model import Robot, load_robot
from arm.se3 import rot_x, transform
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.ik import explain_pose, inverse_kinematics
from plan.kinematics.product_of_exponentials import product_of_exponentials

SAMPLES = 100_000  # poses, as the issue asks; both units


def _distance_to_nearest(found, pose, wanted):  # type: ignore[no-untyped-def]
    nearest = np.full(len(wanted), np.inf)
    np.minimum.at(nearest, pose, np.abs(found - wanted[pose]).max(axis=1))
    return nearest


@pytest.mark.slow
def test_no_branch_is_missed_and_none_is_wrong(robot: Robot, unit: Unit) -> None:
    q = np.random.default_rng(3).uniform(unit.lower, unit.upper, (SAMPLES, 6))
    arm = product_of_exponentials(robot)
    T = arm.tool_poses(q)
    found = inverse_kinematics(robot, T, unit.lower, unit.upper)
    assert np.isfinite(found.q).all()
    assert (np.diff(found.pose) >= 0).all()
    assert not found.singular.any()
    assert _distance_to_nearest(found.q, found.pose, q).max() <= 1e-9
    assert np.abs(arm.tool_poses(found.q) - T[found.pose]).max() <= 1e-10
    assert (found.q >= unit.lower).all()
    assert (found.q <= unit.upper).all()
    assert 5.9 < len(found) / SAMPLES < 6.3  # docs/sources.md, "The arm": 6.1 to 6.5, with other limits


def test_the_branches_of_a_pose_differ_and_carry_their_names(robot: Robot, unit: Unit) -> None:
    q = np.random.default_rng(4).uniform(unit.lower, unit.upper, (2000, 6))
    raw = all_branches(robot, product_of_exponentials(robot).tool_poses(q))
    full = raw.reached.all(axis=1)
    assert full.mean() > 0.9
    turn = raw.q[full][:, :, None] - raw.q[full][:, None]
    gaps = np.abs(np.remainder(turn + np.pi, 2 * np.pi) - np.pi).max(axis=-1)[:, ~np.eye(8, dtype=bool)]
    assert gaps.min() > 1e-6
    # names by geometry: wrist centre against the shoulder, elbow against the line to the wrist, sign of joint 5
    for index, name in enumerate(BRANCH_NAMES):
        shoulder, elbow, wrist = name.split("/")
        for solution in raw.q[full][:50, index]:
            poses = robot.joint_poses(solution)
            centre, hip, knee = poses[5][:3, 3], poses[2][:3, 3], poses[3][:3, 3]
            forward = np.array([np.cos(solution[0]), np.sin(solution[0]), 0.0])
            assert (centre @ forward > 0) == (shoulder == "front")
            along = (centre - hip) / np.linalg.norm(centre - hip)
            above = (knee - hip) - ((knee - hip) @ along) * along
            side = np.cross([0.0, -1.0, 0.0] @ _about_z(solution[0]).T, along)
            assert (above @ side * (1 if shoulder == "front" else -1) > 0) == (elbow == "up")
            assert (solution[4] > 0) == (wrist == "flip")


def _about_z(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


def test_every_configuration_counts_every_other_one(robot: Robot, unit: Unit) -> None:
    """The solutions of a pose are a class: each of them, taken as the start, gives the same set."""
    q = np.random.default_rng(8).uniform(unit.lower, unit.upper, (500, 6))
    first = inverse_kinematics(robot, product_of_exponentials(robot).tool_poses(q), unit.lower, unit.upper)
    again = inverse_kinematics(
        robot, product_of_exponentials(robot).tool_poses(first.q), unit.lower, unit.upper
    )
    counts = np.bincount(first.pose, minlength=500)
    np.testing.assert_array_equal(np.bincount(again.pose, minlength=len(first)), counts[first.pose])
    gap = np.abs(again.q - again_of(first, again.pose)).max()
    assert gap < 1e-8


def again_of(first, pose):  # type: ignore[no-untyped-def]
    """The solutions of the first round in the order of the second: same pose, same order of branches."""
    start = np.searchsorted(first.pose, first.pose)
    rank = np.arange(len(pose)) - np.searchsorted(pose, pose)
    return first.q[start[pose] + rank]


def test_the_distance_from_singularities_is_reported(robot: Robot, unit: Unit) -> None:
    q = np.random.default_rng(9).uniform(unit.lower, unit.upper, (200, 6))
    arm = product_of_exponentials(robot)
    raw = all_branches(robot, arm.tool_poses(q))
    lever = np.abs(np.sin(raw.q[..., 4]))
    assert (raw.sine[raw.reached] <= lever[raw.reached] + 1e-9).all()
    found = raw.sine[raw.reached] / np.abs(np.linalg.det(arm.jacobians(raw.q[raw.reached])))
    assert found.min() > 1.0  # m^3: the determinant vanishes with it


def test_whole_turns_are_found_where_limits_leave_room(robot: Robot) -> None:
    wide = np.full(6, 2.5 * np.pi)
    q = np.random.default_rng(5).uniform(-wide, wide, (300, 6))
    found = inverse_kinematics(robot, product_of_exponentials(robot).tool_poses(q), -wide, wide)
    assert _distance_to_nearest(found.q, found.pose, q).max() <= 1e-9
    q0 = found.of(0).q
    assert len(q0) >= 8 * 2**6
    assert len(np.unique(np.round(q0, 6), axis=0)) == len(q0)


@pytest.mark.parametrize(
    ("q", "where"),
    [
        ([0.3, -0.5, -0.9, 0.4, 0.0, 0.2], "wrist straight"),
        ([0.3, -0.5, 0.0, 0.4, 0.7, 0.2], "elbow straight"),
        ([0.3, 0.0, 0.0, 0.4, 0.0, 0.2], "standing up"),
    ],
)
def test_singular_poses_are_reached_and_flagged(robot: Robot, unit: Unit, q: list[float], where: str) -> None:
    T = robot.T_base_tool(q)
    found = inverse_kinematics(robot, T, unit.lower, unit.upper)
    assert len(found), where
    assert found.singular.any()
    assert np.abs(product_of_exponentials(robot).tool_poses(found.q) - T).max() <= 1e-9


def test_regular_poses_are_not_flagged(robot: Robot, unit: Unit) -> None:
    found = inverse_kinematics(
        robot, robot.T_base_tool([0.3, -0.5, -0.9, 0.4, 0.6, 0.2]), unit.lower, unit.upper
    )
    assert len(found)
    assert not found.singular.any()


def test_near_singular_configurations_are_found_as_exactly_as_they_can_be(robot: Robot, unit: Unit) -> None:
    rng = np.random.default_rng(6)
    q = rng.uniform(unit.lower, unit.upper, (2000, 6))
    q[:1000, 4] = 10.0 ** rng.uniform(-5, -2, 1000)
    q[1000:, 2] = 10.0 ** rng.uniform(-5, -2, 1000)
    found = inverse_kinematics(robot, product_of_exponentials(robot).tool_poses(q), unit.lower, unit.upper)
    nearest = _distance_to_nearest(found.q, found.pose, q)
    # a pose is known to about 1e-15, and a joint as much worse as the singularity is near
    assert (nearest * np.minimum(np.abs(q[:, 4]), np.abs(q[:, 2]))).max() < 3e-12


def test_out_of_reach_says_by_how_much(robot: Robot, unit: Unit) -> None:
    T = robot.T_base_tool([0.0, -1.2, 0.0, 0.0, 0.4, 0.0]).copy()
    direction = robot.joint_poses([0.0, -1.2, 0.0, 0.0, 0.4, 0.0])[5][:3, 3] - (0.0, 0.0, 0.3052)
    T[:3, 3] += 0.05 * direction / np.linalg.norm(direction)
    assert len(inverse_kinematics(robot, T, unit.lower, unit.upper)) == 0
    reports = explain_pose(robot, T, unit.lower, unit.upper)
    assert [r.branch for r in reports] == list(BRANCH_NAMES)
    assert not any(r.inside for r in reports)
    np.testing.assert_allclose([r.outside for r in reports], 0.05, atol=1e-9)


@pytest.mark.parametrize("side", ["lower", "upper"])
@pytest.mark.parametrize("joint", range(6))
def test_a_limit_is_named_with_its_excess(robot: Robot, unit: Unit, side: str, joint: int) -> None:
    """Every joint of the solution has a radian of room, but for one: it is 7 deg beyond one of its limits."""
    q = (unit.lower + unit.upper) / 2 + [0.1, -0.4, -0.3, 0.2, -0.6, 0.1]
    T = robot.T_base_tool(q)
    lower, upper = q - 1.0, q + 1.0
    assert any(r.inside and np.allclose(r.q, q) for r in explain_pose(robot, T, lower, upper))
    shift = np.radians(7.0) + 1.0 if side == "lower" else -np.radians(7.0) - 1.0
    lower[joint] += shift
    upper[joint] += shift
    report = next(r for r in explain_pose(robot, T, lower, upper) if np.allclose(r.q, q))
    assert (report.joint, report.inside) == (f"J{joint + 1}", False)
    assert report.excess == pytest.approx(np.radians(7.0))


def test_a_reached_pose_reports_its_margin_to_the_nearest_limit(robot: Robot, unit: Unit) -> None:
    q = (unit.lower + unit.upper) / 2 + [0.1, -0.4, -0.3, 0.2, -0.6, 0.1]
    lower, upper = q - [0.9, 0.8, 0.7, 0.6, 0.05, 0.4], q + [0.3, 0.4, 0.5, 0.6, 0.7, 0.8]
    report = next(r for r in explain_pose(robot, robot.T_base_tool(q), lower, upper) if np.allclose(r.q, q))
    assert (report.joint, report.inside) == ("J5", True)
    assert report.excess == pytest.approx(-0.05)


def test_a_calibrated_arm_is_solved_too(tmp_path, unit: Unit) -> None:  # type: ignore[no-untyped-def]
    text = data_file("urdf/a465/a465.urdf").read_text()
    bent = text.replace(
        'xyz="0.3048 0 0" rpy="0 0 -1.5707963267948966"', 'xyz="0.3051 0.0002 0" rpy="0.002 0.001 -1.569"'
    )
    bent = bent.replace('rpy="1.5707963267948966 0 0"/><axis', 'rpy="1.5720 0.001 0"/><axis')
    assert bent.count("0.3051") == bent.count("1.5720") == 1
    (tmp_path / "arm.urdf").write_text(bent)
    robot = load_robot(
        tmp_path / "arm.urdf", "flange", transform(t=(0, 0, 0.1)), {"jaw_l": 0.0, "jaw_r": 0.0}
    )
    q = np.random.default_rng(7).uniform(unit.lower, unit.upper, (1000, 6))
    found = inverse_kinematics(
        robot, product_of_exponentials(robot).tool_poses(q), unit.lower - 0.1, unit.upper + 0.1
    )
    missed = _distance_to_nearest(found.q, found.pose, q) > 1e-7
    wrist = np.array([robot.joint_poses(each)[5][:2, 3] for each in q])
    regular = (np.linalg.norm(wrist, axis=1) > 0.06) & (np.abs(q[:, 4]) > 0.01)
    assert regular.mean() > 0.9
    assert not missed[regular].any()
    assert (
        np.abs(
            product_of_exponentials(robot).tool_poses(found.q)
            - product_of_exponentials(robot).tool_poses(q)[found.pose]
        ).max()
        < 1e-10
    )


def test_other_arms_and_broken_poses_are_refused(robot: Robot, tmp_path, unit: Unit) -> None:  # type: ignore[no-untyped-def]
    text = (
        data_file("urdf/a465/a465.urdf")
        .read_text()
        .replace('<origin xyz="0 0 0.3302"', '<origin xyz="0.1 0.1 0.3302"')
    )
    (tmp_path / "arm.urdf").write_text(text)
    other = load_robot(tmp_path / "arm.urdf", "flange", transform(), {"jaw_l": 0.0, "jaw_r": 0.0})
    with pytest.raises(InputError, match="axes 4, 5, 6 that meet in a point"):
        inverse_kinematics(other, transform(rot_x(1.0)), unit.lower, unit.upper)
    with pytest.raises(InputError, match="not finite"):
        inverse_kinematics(robot, np.full((4, 4), np.nan), unit.lower, unit.upper)
