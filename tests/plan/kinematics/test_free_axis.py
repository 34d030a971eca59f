"""Free angles: inside an interval the branch is there and within limits, just outside what is named breaks."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.se3 import rot_x, transform
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.free_axis import FreeInterval, feasible_intervals, sample_free, turned_poses
from plan.kinematics.ik import inverse_kinematics, nearest_turns
from plan.kinematics.product_of_exponentials import product_of_exponentials

POSES = 4
AXES = ("x", "y", "z")


def _cases(robot: Robot, unit: Unit, lower: np.ndarray, upper: np.ndarray, seed: int):  # type: ignore[no-untyped-def]
    q = np.random.default_rng(seed).uniform(
        unit.lower, unit.upper, (POSES // 2 if lower[0] < unit.lower[0] else POSES, 6)
    )
    for k, T in enumerate(product_of_exponentials(robot).tool_poses(q)):
        yield T, AXES[k % 3], feasible_intervals(robot, T, lower, upper, AXES[k % 3])


def _holding(
    intervals: tuple[FreeInterval, ...], branch: str, angle: float
) -> list[tuple[FreeInterval, float]]:
    """Intervals of a branch that hold an angle, which may be whole turns on, with the angle inside them."""
    return [
        (i, a)
        for i in intervals
        for a in (angle, angle + 2 * np.pi)
        if i.branch == branch and i.start <= a <= i.end
    ]


def _near_an_end(intervals: tuple[FreeInterval, ...], angle: float) -> bool:
    ends = np.array([[i.start, i.end] for i in intervals if i.stops != ("", "")]).ravel()
    return bool(len(ends) and np.abs(np.remainder(ends - angle + np.pi, 2 * np.pi) - np.pi).min() < 1e-6)


@pytest.mark.few(1)
@pytest.mark.parametrize("room", [0.0, 0.7])
def test_intervals_are_the_solutions_of_every_angle(robot: Robot, unit: Unit, room: float) -> None:
    """At random angles, the intervals that hold it are as many as the solutions there, and lie on them."""
    lower, upper = unit.lower - room, unit.upper + room
    count = 0
    for T, axis, intervals in _cases(robot, unit, lower, upper, seed=31):
        angles = np.random.default_rng(32).uniform(-np.pi, np.pi, 120)
        found = inverse_kinematics(robot, turned_poses(T, axis, angles), lower, upper)
        for k, angle in enumerate(angles):
            if _near_an_end(intervals, angle):
                continue
            rows = np.flatnonzero(found.pose == k)
            for branch in np.unique(found.branch[rows]):
                here = [r for r in rows if found.branch[r] == branch]
                holding = _holding(intervals, BRANCH_NAMES[branch], angle)
                assert len(holding) == len(here)
                for r in here:
                    gaps = [_gap(i, a, found.q[r]) for i, a in holding]
                    assert min(gaps) < 0.05
                    count += 1
            assert sum(len(_holding(intervals, b, angle)) for b in BRANCH_NAMES) == len(rows)
    assert count > 200


def _gap(interval: FreeInterval, angle: float, q: np.ndarray) -> float:
    near = [np.interp(angle, interval.angles, column) for column in interval.q.T]
    return float(np.abs(near - q).max())


@pytest.mark.few(1)
def test_a_pose_just_beyond_a_stop_violates_the_named_limit(robot: Robot, unit: Unit) -> None:
    named = set()
    for T, axis, intervals in _cases(robot, unit, unit.lower, unit.upper, seed=33):
        for i in intervals:
            poses = turned_poses(T, axis, i.angles)
            assert np.abs(product_of_exponentials(robot).tool_poses(i.q) - poses).max() < 1e-9
            assert (i.q >= unit.lower).all()
            assert (i.q <= unit.upper).all()
            assert (np.diff(i.angles) > 0).all()
            assert i.length <= 2 * np.pi + 1e-9
            for side, stop in zip((0, -1), i.stops, strict=True):
                if stop:
                    named.add(stop.split()[0])
                    _broken(robot, unit, T, axis, i, side, stop)
    assert {"J1", "J4", "J5", "reach"} <= named


def _broken(
    robot: Robot, unit: Unit, T: np.ndarray, axis: str, interval: FreeInterval, side: int, stop: str
) -> None:
    outside = interval.angles[side] + (1e-6 if side else -1e-6)
    raw = all_branches(robot, turned_poses(T, axis, [outside]))
    index = BRANCH_NAMES.index(interval.branch)
    if stop == "reach":
        assert not raw.reached[0, index]
        return
    q = nearest_turns(raw.q[0, index], interval.q[side])
    if stop == "singular":
        assert np.abs(q - interval.q[side]).max() > 0.2
        return
    joint = robot.joint_names.index(stop.split()[0])
    assert (q[joint] > unit.upper[joint]) if "upper" in stop else (q[joint] < unit.lower[joint])


@pytest.mark.few(1)
def test_samples_reach_their_poses_within_limits(robot: Robot, unit: Unit) -> None:
    for T, axis, intervals in _cases(robot, unit, unit.lower, unit.upper, seed=34):
        q, interval, _ = sample_free(robot, T, intervals, 40, axis)
        assert abs(len(q) - 40) <= len(intervals)
        assert set(interval) == set(range(len(intervals)))
        columns = [AXES.index(axis), 3]  # a turn about the axis keeps it and the origin
        tools = product_of_exponentials(robot).tool_poses(q)[..., columns]
        np.testing.assert_allclose(tools, np.broadcast_to(T[:, columns], tools.shape), atol=1e-9)
        assert (q >= unit.lower).all()
        assert (q <= unit.upper).all()


def test_a_singular_angle_is_flagged(robot: Robot, unit: Unit) -> None:
    """With joints 4 and 6 at zero the arm is plane: turned in that plane, the hand passes in line with the forearm."""
    for bend in (0.3, -0.4):
        T = robot.T_base_tool([0.2, -0.7, -0.8, 0.0, bend, 0.0])
        intervals = feasible_intervals(robot, T, unit.lower, unit.upper, "y")
        flagged = [a for i in intervals if i.branch.startswith("front/up") for a in i.singular]
        assert flagged
        for angle in flagged:
            raw = all_branches(robot, turned_poses(T, "y", [angle]))
            assert raw.sine[0].min() < 1e-3


def test_a_grasp_from_above_has_two_intervals_and_a_far_pose_none(robot: Robot, crs97: Unit) -> None:
    T = transform(rot_x(np.pi), (0.46, 0.11, 0.05))
    intervals = feasible_intervals(robot, T, crs97.lower, crs97.upper)
    # joint 6 turns 358 deg between its limits, and only it turns
    assert [round(np.degrees(i.length), 6) for i in intervals] == [358.0, 358.0]
    assert all(i.stops == ("J6 lower limit", "J6 upper limit") for i in intervals)
    far = transform(rot_x(np.pi), (2.0, 0.0, 0.0))
    assert feasible_intervals(robot, far, crs97.lower, crs97.upper) == ()
    assert len(sample_free(robot, far, (), 10)[0]) == 0
    with pytest.raises(InputError, match="axis = 'yaw': must be one of x, y, z"):
        feasible_intervals(robot, T, crs97.lower, crs97.upper, "yaw")
