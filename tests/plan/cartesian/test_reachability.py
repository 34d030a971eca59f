"""Reach: the default Task 2, and reasons that can be checked."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import read_board_csv
from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from arm.robot.model import Robot
from arm.se3 import rot_x, rot_z, rotation, transform
from plan.cartesian.reachability import reach
from plan.kinematics.closed_form import BRANCH_NAMES, all_branches
from plan.kinematics.product_of_exponentials import product_of_exponentials

OFFSET = 0.1


def _board(centre, yaw_deg, tilt_deg, towards_deg):  # type: ignore[no-untyped-def]
    yaw, tilt, towards = np.radians([yaw_deg, tilt_deg, towards_deg])
    R = rotation(tilt * np.array([-np.sin(towards), np.cos(towards), 0.0])) @ rot_z(yaw)
    return transform(R, np.array(centre) - R @ (0.09, 0.07, 0.0))


def _task_2(shift=(0.0, 0.0, 0.0)):  # type: ignore[no-untyped-def]
    """The default placement of docs/sources.md, "Boards and cubes"; tip 15 mm above the plate, four yaws."""
    grasps = {}
    for name, T in (
        ("01-02", _board((0.46, 0.11, 0.04), 175, 7, 265)),
        ("03-04", _board((0.46, -0.13, 0.09), 90, 15, 270)),
    ):
        board = read_board_csv(data_file(f"scenes/boards/positions_plate_{name}.csv"), 0.036)
        for i in range(4):
            hole = transform(t=shift) @ T @ board.T_board_hole(i) @ transform(rot_x(np.pi), (0, 0, 0.015))
            grasps[f"{name}/{i + 1}"] = [hole @ transform(rot_z(k * np.pi / 2)) for k in range(4)]
    return grasps


def test_all_eight_holes_of_the_default_task_are_reached_with_the_margin_of_the_sheet(
    robot: Robot, unit: Unit
) -> None:
    table = reach(robot, unit.limits(), _task_2(), OFFSET)
    table.require()
    assert table.ok
    margins = [hole.best.margin for hole in table.holes]
    assert len(margins) == 8
    assert np.degrees(min(margins)) == pytest.approx(16.6, abs=0.05)


def test_candidates_reach_their_holes_and_state_their_margins(robot: Robot, unit: Unit) -> None:
    grasps, arm = _task_2(), product_of_exponentials(robot)
    for hole in reach(robot, unit.limits(), grasps, OFFSET).holes:
        assert [c.ok for c in hole.choices] == sorted((c.ok for c in hole.choices), reverse=True)
        assert len(hole.choices) == 32
        for choice in hole.feasible():
            T = grasps[hole.hole][choice.yaw]
            np.testing.assert_allclose(arm.tool_poses(choice.q_hole), T, atol=1e-9)
            top = arm.tool_poses(choice.q_offset)
            np.testing.assert_allclose(top[:3, 3], T[:3, 3] - OFFSET * T[:3, 2], atol=1e-9)
            for q in (choice.q_hole, choice.q_offset):
                assert np.minimum(q - unit.lower, unit.upper - q).min() >= choice.margin - 1e-12


def test_a_limit_along_the_line_is_found_between_its_ends(robot: Robot, crs97: Unit) -> None:
    """Joint 2 turns back half-way along this line: its ends are inside, its middle is not."""
    limits = crs97.limits()
    T = transform(rot_x(np.pi) @ rot_z(1.0), (0.46, 0.0, 0.1))
    free = reach(robot, limits, {"h": [T]}, 0.3)["h"].best
    assert free.ok
    s = np.linspace(0, 0.3, 301)
    poses = np.stack([transform(T[:3, :3], T[:3, 3] - h * T[:3, 2]) for h in s])
    q = np.unwrap(all_branches(robot, poses).q[:, BRANCH_NAMES.index(free.branch)], axis=0)
    bulge = np.maximum(q.max(axis=0) - np.maximum(q[0], q[-1]), 0.0)
    joint = int(np.argmax(bulge))
    assert bulge[joint] > 0.004
    upper = limits.upper.copy()
    upper[joint] = max(q[0, joint], q[-1, joint]) + bulge[joint] / 2
    tight = reach(
        robot, type(limits)(limits.lower, upper, limits.velocity, limits.acceleration), {"h": [T]}, 0.3
    )
    same = next(c for c in tight["h"].choices if c.branch == free.branch)
    assert not same.ok
    assert same.joint == f"J{joint + 1}"
    assert -same.margin == pytest.approx(bulge[joint] / 2, rel=0.05)


def test_a_board_too_far_away_names_holes_and_millimetres(robot: Robot, unit: Unit) -> None:
    near, far = _task_2(), _task_2((0.3, 0.0, 0.0))
    mixed = {**near, **{name: far[name] for name in ("03-04/2",)}}
    table = reach(robot, unit.limits(), mixed, OFFSET)
    assert not table.ok
    with pytest.raises(
        ImpossibleError, match=r"hole 03-04/2: best branch \S+, the line leaves the workspace by"
    ) as caught:
        table.require()
    (entry,) = caught.value.data["holes"]
    # the wrist's centre from the shoulder, over the whole line and all yaws, against the two links
    excess = []
    for T in far["03-04/2"]:
        wrist = T[:3, 3] - (0.0762 + 0.134112 + np.linspace(0, OFFSET, 11)[:, None]) * T[:3, 2]
        excess.append((np.linalg.norm(wrist - (0, 0, 0.3052), axis=1) - 0.3048 - 0.3302).max())
    assert entry["outside_mm"] == pytest.approx(min(excess) * 1e3, abs=1e-6)


def test_a_joint_limit_is_named_with_degrees(robot: Robot, crs97: Unit) -> None:
    near = {k: [transform(t=(-0.22, 0.0, 0.0)) @ T for T in v] for k, v in _task_2().items()}
    table = reach(robot, crs97.limits(), near, OFFSET)
    with pytest.raises(ImpossibleError, match=r"joint J\d goes [\d.]+ deg beyond its limit") as caught:
        table.require()
    named = next(e for e in caught.value.data["holes"] if "joint" in e)
    best = table[named["hole"]].best
    assert named["excess_deg"] == pytest.approx(np.degrees(-best.margin))


def test_a_line_through_a_singular_pose_is_not_served_by_racing_branches(robot: Robot, crs97: Unit) -> None:
    q = np.radians([0.0, -40.0, -70.0, 150.0, 0.02, -100.0])
    limits, turns = crs97.limits(), np.full(6, 2 * np.pi)
    wide = type(limits)(-turns, turns, limits.velocity, limits.acceleration)
    racing = [c for c in reach(robot, wide, {"h": [robot.T_base_tool(q)]}, OFFSET)["h"].choices if c.racing]
    assert racing
    for choice in racing:
        assert choice.margin > 0.0
        assert choice.outside == 0.0
        assert not choice.ok
        assert "near a singular configuration" in choice.reason()


def test_nonsense_is_refused(robot: Robot, crs97: Unit) -> None:
    with pytest.raises(InputError, match="one or more holes, each with one or more poses"):
        reach(robot, crs97.limits(), {}, OFFSET)
    with pytest.raises(InputError, match="must be positive"):
        reach(robot, crs97.limits(), {"h": [transform()]}, 0.0)
    with pytest.raises(InputError, match="one of h"):
        reach(robot, crs97.limits(), {"h": [transform()]}, OFFSET)["g"]
