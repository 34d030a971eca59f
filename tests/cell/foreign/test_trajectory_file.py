"""Joint trajectories of other programs are read as their controllers follow them, and wrong ones are refused."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from arm.errors import InputError
from cell.foreign.trajectory_file import read_trajectory

JOINTS = ("a", "b", "c")
_REST, _HALF = [0.0, 0.0, 0.0], 500_000_000
_GOOD: dict[str, Any] = {
    "joint_names": ["c", "a", "b"],
    "points": [
        {"positions": [3.0, 1.0, 2.0], "velocities": _REST, "time_from_start": {"sec": 0, "nanosec": 0}},
        {"positions": [3.5, 1.1, 2.2], "velocities": [0.3, 0.1, 0.2], "time_from_start": {"sec": 1, "nanosec": _HALF}},
        {"positions": [3.2, 1.0, 2.0], "velocities": _REST, "time_from_start": {"sec": 4, "nanosec": 0}},
    ],
}  # fmt: skip


def _written(folder: Path, value: Any) -> Path:
    file = folder / "trajectory.json"
    file.write_text(json.dumps(value))
    return file


@pytest.mark.parametrize("seed", range(3))
def test_between_points_with_velocities_joints_follow_cubics(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.05, 1.0, 7))
    q, rate = rng.normal(0.0, 1.0, (2, 7, 3))
    points = [
        {"positions": q[k].tolist(), "velocities": rate[k].tolist(), "time_from_start": times[k]}
        for k in range(7)
    ]
    read = read_trajectory(_written(tmp_path, {"joint_names": list(JOINTS), "points": points}), JOINTS)
    truth = CubicHermiteSpline(times, q, rate)
    at = rng.uniform(times[0], times[-1], 200)
    found, speed = read.at(at - times[0])
    np.testing.assert_allclose(found, truth(at), atol=1e-12)
    np.testing.assert_allclose(speed, truth(at, 1), atol=1e-10)
    control = read.curve.control
    np.testing.assert_allclose(control[:, [0, 3]], np.stack([q[:-1], q[1:]], axis=1), atol=1e-12)
    middle = (control * np.array([1.0, 3.0, 3.0, 1.0])[:, None] / 8.0).sum(axis=1)
    np.testing.assert_allclose(middle, truth((times[:-1] + times[1:]) / 2.0), atol=1e-12)
    np.testing.assert_allclose(read.curve.ends, times[1:] - times[0])


def test_joints_are_put_into_the_order_of_the_arm_and_without_velocities_move_on_lines(
    tmp_path: Path,
) -> None:
    value = copy.deepcopy(_GOOD)
    read = read_trajectory(_written(tmp_path, value), JOINTS)
    np.testing.assert_allclose(read.q[0], [1.0, 2.0, 3.0])
    assert read.velocity is not None
    np.testing.assert_allclose(read.velocity[1], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(read.times, [0.0, 1.5, 4.0])
    for point in value["points"]:
        del point["velocities"]
    lines = read_trajectory(_written(tmp_path, {"trajectory": {"joint_trajectory": value}}), JOINTS)
    assert lines.velocity is None
    np.testing.assert_allclose(lines.at(np.array([0.75]))[0], [[1.05, 2.1, 3.25]])


@pytest.mark.parametrize(
    ("place", "value", "message"),
    [
        (("joint_names",), ["c", "a"], r"joint_names.*lacks b"),
        (("joint_names",), ["c", "a", "d"], r"joint_names.*'d' is no joint of the arm"),
        (("joint_names",), ["c", "a", "a"], r"joint_names.*'a' names it twice"),
        (("joint_names",), [], r"joint_names"),
        (("points",), [], r"points.*has 0 points; must have 2"),
        (("points", 1, "positions"), [1.0, 2.0], r"points\[1\].positions.*3 numbers"),
        (("points", 1, "positions"), [1.0, 2.0, None], r"points\[1\].positions"),
        (
            ("points", 1, "velocities"),
            [],
            r"points\[1\].velocities.*all points must have velocities, or none",
        ),
        (("points", 1, "accelerations"), [1.0, 0.0, 0.0], r"points\[1\].accelerations.*quintics"),
        (("points", 1, "time_from_start"), 4.5, r"points\[2\].time_from_start.*is 4 s, not after 4.5 s"),
        (
            ("points", 1, "time_from_start"),
            {"sec": 0, "nanosec": 0},
            r"points\[1\].time_from_start.*must increase",
        ),
        (("points", 1, "time_from_start"), {"seconds": 1}, r"points\[1\].time_from_start.*must be a time"),
        (("points", 1, "time_from_start"), "1 s", r"points\[1\].time_from_start.*must be a time"),
        (
            ("points", 1, "time_from_start"),
            1e-200,
            r"points\[1\].time_from_start.*must increase by 1 us or more",
        ),
        (("points", 1, "time_from_start"), {"sec": 10**400, "nanosec": 0}, r"points\[1\].time_from_start"),
        (
            ("points", 1, "time_from_start"),
            {"sec": 0, "nanosec": 1_500_000_000},
            r"points\[1\].time_from_start.*must have less than 1000000000 ns",
        ),
        (
            ("points", 1, "time_from_start"),
            {"sec": 1, "nanosecs": 5},
            r"points\[1\].time_from_start.*must be a time",
        ),
        (
            ("points", 1, "time_from_start"),
            {"sec": 0, "secs": 4, "nsecs": 7},
            r"points\[1\].time_from_start.*must be a",
        ),
        (("points", 1, "velocities"), 0, r"points\[1\].velocities"),
        (("points", 1, "accelerations"), "", r"points\[1\].accelerations"),
        (("points", 1, "time_from_start"), -1.0, r"points\[1\].time_from_start.*must be a time"),
        (("points", 1, "time_from_start"), 4e9, r"time_from_start.*\(is it in ns\?\)$"),
        (("points", 1, "time_from_start"), 4e5, r"time_from_start.*\(is it in ms\?\)$"),
        (("points", 1, "time_from_start"), {"sec": 1_795_000_000, "nanosec": 0}, r"\(is it the time of day"),
        (("points", 1, "time_from_start"), {"sec": 1}, r"time_from_start.*\(it lacks nanosec\)$"),
        (("points", 1, "time_from_start"), {"sec": "1", "nanosec": 0}, r"\(its numbers stand in quotation"),
        (("points", 1, "time_from_start"), {"sec": 1, "nanosec": 0.5}, r"must have a whole number of ns"),
        (
            ("points", 2, "time_from_start"),
            1.5,
            r"\(is it the time from the point before\? It counts from the",
        ),
        (("points", 2), _GOOD["points"][1], r"time_from_start.*\(the point is there twice: leave out one\)$"),
        (
            ("points", 1, "time_from_start"),
            {"sec": 0, "nanosec": 4},
            r"time_from_start.*\(nanosec is in ns\)$",
        ),
        (("points", 1, "velocity"), [0.0, 0.0, 0.0], r"points\[1\].velocity.*\(did you mean velocities\?\)$"),
        (("points", 1, "time"), 1.0, r"points\[1\].time.*\(did you mean time_from_start\?\)$"),
        (("points", 1, "q"), [0.0, 0.0, 0.0], r"points\[1\].q.*\(known: positions, velocities"),
        (("angles",), "deg", r"angles = 'deg': is not read: positions are in rad"),
    ],
)
def test_a_wrong_trajectory_is_refused_with_place_and_rule(
    tmp_path: Path, place: tuple[str | int, ...], value: Any, message: str
) -> None:
    changed = copy.deepcopy(_GOOD)
    at: Any = changed
    for name in place[:-1]:
        at = at[name]
    at[place[-1]] = value
    with pytest.raises(InputError, match=message) as caught:
        read_trajectory(_written(tmp_path, changed), JOINTS)
    assert "trajectory.json" in str(caught.value)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="must be a trajectory_msgs/JointTrajectory"):
        read_trajectory(_written(tmp_path, {"steps": []}), JOINTS)


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ({"goal": {"trajectory": _GOOD}}, r"\(there is one in goal.trajectory: give a file with that alone\)$"),
        (
            {"sub_trajectory": [{"trajectory": {"joint_trajectory": _GOOD}}]},
            r"\(there is one in sub_trajectory\[0\].trajectory.joint_trajectory: ",
        ),
        ({"name": ["a"], "position": [1.0], "velocity": []}, r"\(it is like a sensor_msgs/JointState, which is one"),
        ({"times": [], "q": []}, r"must be a trajectory_msgs/JointTrajectory.*\(the file has times, q\)$"),
        ([_GOOD, _GOOD], r"is a list of 2 trajectories; must be one \(give a file with \[0\] alone\)$"),
        (_GOOD["points"], r"is a list of 3, and must be a trajectory_msgs/JointTrajectory"),
        ([[0.0, 1.0]], r"is a list of 1, and must be a trajectory_msgs/JointTrajectory"),
    ],
)  # fmt: skip
def test_what_is_there_instead_of_a_trajectory_is_told(tmp_path: Path, value: Any, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read_trajectory(_written(tmp_path, value), JOINTS)


@pytest.mark.parametrize("more", [None, [], {}, {"points": []}, {"points": None}])
def test_no_points_of_other_joints_are_no_fault(tmp_path: Path, more: Any) -> None:
    value = {"joint_trajectory": _GOOD, "multi_dof_joint_trajectory": more}
    assert len(read_trajectory(_written(tmp_path, value), JOINTS).times) == 3
    for full in ({"points": [1]}, [1], 7):
        with pytest.raises(InputError, match="moves what this arm has not; must have no points"):
            read_trajectory(_written(tmp_path, {**value, "multi_dof_joint_trajectory": full}), JOINTS)


def test_a_unit_that_is_the_right_one_is_no_fault(tmp_path: Path) -> None:
    assert len(read_trajectory(_written(tmp_path, {**_GOOD, "angles": "rad"}), JOINTS).times) == 3


@pytest.mark.parametrize("count", [1, 2])
def test_a_display_trajectory_is_told(tmp_path: Path, count: int) -> None:
    shown = {"model_id": "a", "trajectory": [{"joint_trajectory": _GOOD}] * count, "trajectory_start": {}}
    told = (
        rf"trajectory.*: is a list of {count}, as in a moveit_msgs/DisplayTrajectory; must be one trajectory "
        r"\(give a file with trajectory\[0\] alone\)$"
    )
    with pytest.raises(InputError, match=told):
        read_trajectory(_written(tmp_path, shown), JOINTS)
    assert len(read_trajectory(_written(tmp_path, shown["trajectory"][0]), JOINTS).times) == 3  # type: ignore[index]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"trajectory": _GOOD}, r"trajectory.*is a second trajectory beside joint_trajectory"),
        (
            {"multi_dof_joint_trajectory": {"points": [{}]}},
            r"multi_dof_joint_trajectory.*must have no points",
        ),
    ],
)
def test_a_message_that_says_more_than_is_judged_is_refused(
    tmp_path: Path, more: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        read_trajectory(_written(tmp_path, {"joint_trajectory": _GOOD, **more}), JOINTS)
    good = {"joint_trajectory": _GOOD, "multi_dof_joint_trajectory": {"points": []}}
    assert len(read_trajectory(_written(tmp_path, good), JOINTS).times) == 3
