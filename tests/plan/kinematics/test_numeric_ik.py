"""The numerical way against the closed form, and on arms that have none (their dimensions are made up)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot, load_robot
from arm.se3 import rot_x, rot_z, rotation, transform
from arms.made_up import UR_LIKE, arm
from plan.kinematics.closed_form import BRANCH_NAMES
from plan.kinematics.numeric_ik import SearchOptions, numeric_ik, solutions_near, solve_ik
from plan.kinematics.product_of_exponentials import product_of_exponentials

# joint: origin xyz, origin rpy, axis, kind
_Z, _Y, _X = "0 0 1", "0 1 0", "1 0 0"
OFFSET_WRIST = [  # three parallel axes, and a wrist whose axes do not meet
    ("0 0 0.12", "0 0 0", _Z, "revolute"),
    ("0 0.11 0", "0 1.5707963267948966 0", _Y, "revolute"),
    ("0 -0.09 0.37", "0 0 0", _Y, "revolute"),
    ("0 0 0.33", "0 1.5707963267948966 0", _Y, "revolute"),
    ("0 0.08 0", "0 0 0", _Z, "revolute"),
    ("0 0 0.09", "0 0 0", _Y, "revolute"),
]
SEVEN = [
    ("0 0 0.3", "0 0 0", _Z, "revolute"),
    ("0 0 0", "0 0 0", _Y, "revolute"),
    ("0 0 0.3", "0 0 0", _Z, "revolute"),
    ("0.04 0 0", "0 0 0", _Y, "revolute"),
    ("-0.04 0 0.3", "0 0 0", _Z, "revolute"),
    ("0 0 0", "0 0 0", _Y, "revolute"),
    ("0.05 0 0.1", "0 0 0", _Z, "revolute"),
]
SCARA = [
    ("0 0 0.35", "0 0 0", _Z, "revolute"),
    ("0.25 0 0", "0 0 0", _Z, "revolute"),
    ("0.2 0 0", "3.141592653589793 0 0", _Z, "prismatic"),
    ("0 0 0", "0 0 0", _Z, "revolute"),
]
FIVE = [
    ("0 0 0.2", "0 0 0", _Z, "revolute"),
    ("0 0 0.05", "0 0 0", _Y, "revolute"),
    ("0 0 0.25", "0 0 0", _Y, "revolute"),
    ("0 0 0.22", "0 0 0", _Y, "revolute"),
    ("0 0 0.1", "0 0 0", _Z, "revolute"),
]


def _arm(path: Path, joints: list[tuple[str, str, str, str]]) -> Robot:
    links = "".join(f'<link name="l{k}"/>' for k in range(len(joints) + 1))
    chain = "".join(
        f'<joint name="q{k + 1}" type="{kind}"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="1"/></joint>'
        for k, (xyz, rpy, axis, kind) in enumerate(joints)
    )
    (path / "arm.urdf").write_text(f'<robot name="made_up">{links}{chain}</robot>')
    return load_robot(path / "arm.urdf", f"l{len(joints)}", transform(t=(0.02, 0.0, 0.07)))


def _random(robot: Robot, lower: np.ndarray, upper: np.ndarray, count: int, seed: int):  # type: ignore[no-untyped-def]
    q = np.random.default_rng(seed).uniform(lower, upper, (count, len(lower)))
    return q, product_of_exponentials(robot).tool_poses(q)


def _check(robot: Robot, found, T: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    assert np.abs(product_of_exponentials(robot).tool_poses(found.q) - T[found.pose]).max() < 1e-9
    assert (found.q >= lower).all()
    assert (found.q <= upper).all()
    assert (np.diff(found.pose) >= 0).all()


def _share_found(found, wanted: np.ndarray) -> float:  # type: ignore[no-untyped-def]
    return float(
        np.mean([np.abs(found.of(k).q - q).max(axis=1).min(initial=9.0) < 1e-6 for k, q in enumerate(wanted)])
    )


@pytest.mark.few(1)
def test_the_numeric_search_finds_the_closed_form_solutions(robot: Robot, unit: Unit) -> None:
    """At least 99 % are asked for; 3581 of 3587 were found on 300 poses of each unit (128 starts)."""
    _, T = _random(robot, unit.lower, unit.upper, 60, seed=41)
    exact = solve_ik(robot, T, unit.lower, unit.upper)
    assert set(exact.branch) <= set(BRANCH_NAMES)
    found = numeric_ik(robot, T, unit.lower, unit.upper)
    _check(robot, found, T, unit.lower, unit.upper)
    assert set(found.branch) == {""}
    hits = sum(
        np.abs(found.of(p).q - q).max(axis=1).min(initial=9.0) < 1e-6
        for q, p in zip(exact.q, exact.pose, strict=True)
    )
    assert hits >= 0.99 * len(exact)
    assert len(found) == hits  # and nothing else


def test_an_arm_without_a_spherical_wrist(tmp_path: Path) -> None:
    robot, upper = _arm(tmp_path, OFFSET_WRIST), np.full(6, np.pi)
    q, T = _random(robot, -upper, upper, 40, seed=42)
    found = solve_ik(robot, T, -upper, upper)
    _check(robot, found, T, -upper, upper)
    assert _share_found(found, q) == 1.0
    counts = np.bincount(found.pose, minlength=40)
    assert counts.max() <= 8  # as for every arm with three parallel axes
    assert (counts % 2 == 0).all()  # solutions come in pairs
    np.testing.assert_array_equal(found.q, solve_ik(robot, T, -upper, upper).q)


def test_seven_joints_give_points_of_a_continuum(tmp_path: Path) -> None:
    robot, upper = _arm(tmp_path, SEVEN), np.array([2.8, 1.9, 2.8, 2.2, 2.8, 1.9, 2.8])
    _, T = _random(robot, -upper, upper, 10, seed=43)
    found = solve_ik(robot, T, -upper, upper, options=SearchOptions(starts=48))
    _check(robot, found, T, -upper, upper)
    assert np.bincount(found.pose, minlength=10).min() >= 5
    assert len(found.q[0]) == 7


def test_a_sliding_joint_and_fewer_joints_than_directions(tmp_path: Path) -> None:
    robot = _arm(tmp_path, SCARA)
    lower, upper = np.array([-2.5, -2.4, 0.0, -6.0]), np.array([2.5, 2.4, 0.2, 6.0])
    q, T = _random(robot, lower, upper, 20, seed=44)
    found = solve_ik(robot, T, lower, upper)
    _check(robot, found, T, lower, upper)
    assert _share_found(found, q) == 1.0
    # its tool cannot tilt: a tilted pose is out of reach, unless both tilts are free
    tilted = T @ transform(rot_x(0.1))
    assert len(solve_ik(robot, tilted, lower, upper)) == 0
    freed = solve_ik(robot, tilted, lower, upper, free=("rx", "ry"))
    assert set(freed.pose) == set(range(20))
    places = product_of_exponentials(robot).tool_poses(freed.q)[:, :3, 3]
    np.testing.assert_allclose(places, tilted[freed.pose, :3, 3], atol=1e-9)
    # a place alone, at any height the slide likes
    heights = solve_ik(robot, T[0], lower, upper, free=("z", "rx", "ry", "rz"))
    apart = np.linalg.inv(T[0]) @ product_of_exponentials(robot).tool_poses(heights.q)
    np.testing.assert_allclose(apart[:, :2, 3], 0.0, atol=1e-9)
    assert np.ptp(apart[:, 2, 3]) > 0.05


def test_five_joints_reach_a_pose_but_for_its_yaw(tmp_path: Path) -> None:
    robot, upper = _arm(tmp_path, FIVE), np.array([3.0, 2.0, 2.4, 2.0, 3.0])
    q, T = _random(robot, -upper, upper, 20, seed=45)
    free_yaw = T @ transform(rot_z(0.7))
    assert len(solve_ik(robot, free_yaw, -upper, upper)) == 0
    found = solve_ik(robot, free_yaw, -upper, upper, free="rz")
    apart = np.linalg.inv(free_yaw[found.pose]) @ product_of_exponentials(robot).tool_poses(found.q)
    np.testing.assert_allclose(apart[:, :3, 3], 0.0, atol=1e-9)
    np.testing.assert_allclose(apart[:, :3, 2], np.tile([0.0, 0.0, 1.0], (len(apart), 1)), atol=1e-9)
    assert _share_found(found, q) == 1.0


def test_a_free_rotation_of_the_a465_goes_by_the_closed_form(robot: Robot, crs97: Unit) -> None:
    T = transform(rot_x(np.pi), (0.46, 0.11, 0.05))
    found = solve_ik(robot, T, crs97.lower, crs97.upper, free="rz")
    assert set(found.branch) == {"front/up/noflip", "back/up/flip"}
    apart = np.linalg.inv(T) @ product_of_exponentials(robot).tool_poses(found.q)
    np.testing.assert_allclose(apart[:, :3, 3], 0.0, atol=1e-9)
    np.testing.assert_allclose(apart[:, 2, 2], 1.0, atol=1e-12)
    # numerically every start has its own yaw, on the same two branches
    other = numeric_ik(robot, T, crs97.lower, crs97.upper, free="rz", options=SearchOptions(starts=32))
    apart = np.linalg.inv(T) @ product_of_exponentials(robot).tool_poses(other.q)
    np.testing.assert_allclose(apart[:, :3, 3], 0.0, atol=1e-9)
    assert len(other) >= 8


def test_singular_solutions_are_flagged(robot: Robot, crs97: Unit) -> None:
    straight = robot.T_base_tool([0.3, -0.5, -0.9, 0.4, 0.0, 0.2])
    found = numeric_ik(
        robot, straight, crs97.lower, crs97.upper, options=SearchOptions(starts=64, iterations=60)
    )
    assert len(found)
    assert (np.abs(found.q[found.singular][:, 4]) < 1e-4).all()
    regular = robot.T_base_tool([0.3, -0.5, -0.9, 0.4, 0.6, 0.2])
    assert not numeric_ik(robot, regular, crs97.lower, crs97.upper).singular.any()


def test_a_rotation_error_of_180_deg_is_not_a_solution(tmp_path: Path) -> None:
    """Where the rotation error is exactly half a turn its axis is lost; that must not pass for an answer."""
    robot = _arm(tmp_path, SCARA[2:3])
    T = product_of_exponentials(robot).tool_poses([0.1])
    assert len(numeric_ik(robot, T, [0.0], [0.2])) == 1
    for turn in (rot_x(np.pi), rotation((0.0, np.pi, 0.0)), rot_z(np.pi)):
        assert len(numeric_ik(robot, T @ transform(turn), [0.0], [0.2])) == 0


def test_starts_lead_to_the_solutions_nearby(robot: Robot, crs97: Unit) -> None:
    """Each to its own pose, within limits; one that has none nearby says so."""
    rng = np.random.default_rng(8)
    q = rng.uniform(crs97.lower, crs97.upper, (40, 6))
    T = np.stack([robot.T_base_tool(one) for one in q])
    starts = np.clip(q + rng.uniform(-0.02, 0.02, q.shape), crs97.lower, crs97.upper)
    T[-1, :3, 3] += 2.0
    found, met = solutions_near(robot, starts, T, crs97.lower, crs97.upper)
    assert met[:-1].sum() >= 36
    assert not met[-1]
    for one, pose in zip(found[met], T[met], strict=True):
        np.testing.assert_allclose(robot.T_base_tool(one), pose, atol=1e-7)
    assert np.abs(found - starts)[met].max() < 0.5
    turned = T @ transform(rot_z(0.3))
    found, met = solutions_near(robot, q, turned, crs97.lower, crs97.upper, "rz")
    assert met[:-1].all()
    np.testing.assert_allclose(found[met], q[met], atol=1e-6)


def test_a_solution_nearby_beyond_a_full_circles_limit_is_none(tmp_path: Path) -> None:
    robot = arm(tmp_path, UR_LIKE, [])
    q = np.array([[0.3, -0.8, 1.2, 0.4, 0.9, 6.15]])
    limit = np.full(6, 6.2)
    for turn, wanted in ((0.03, True), (0.2, False)):
        T = robot.T_base_tool(q[0] + [0.0, 0.0, 0.0, 0.0, 0.0, turn])
        found, met = solutions_near(robot, q, T[None], -limit, limit)
        assert bool(met[0]) is wanted
        assert not wanted or (found <= limit).all()


def test_wrong_questions_are_refused(robot: Robot, crs97: Unit) -> None:
    T = transform(rot_x(np.pi), (0.46, 0.11, 0.05))
    with pytest.raises(InputError, match="free = 'yaw': must be one of x, y, z, rx, ry, rz"):
        solve_ik(robot, T, crs97.lower, crs97.upper, free="yaw")
    with pytest.raises(InputError, match="lower, upper: must be 6 numbers each"):
        numeric_ik(robot, T, crs97.lower[:5], crs97.upper)
    with pytest.raises(InputError, match="not finite"):
        numeric_ik(robot, np.full((4, 4), np.nan), crs97.lower, crs97.upper)
