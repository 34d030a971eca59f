"""Lists of poses on the A465: reached in order, within limits, clear by MuJoCo too, and the best of all ways."""

from __future__ import annotations

import json

import numpy as np

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from arms.mujoco_cell import MujocoCell
from plan.collision.certificate import certify_move
from plan.kinematics.straight_line import Line
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.goals.target import Target
from plan.program.planned import Pause, Planned
from plan.program.pose_lists import plan_poses
from plan.scene import Scene
from tasks.pose_lists import FAST, TABLE, check_plan, down


def test_poses_are_reached_within_limits(row: tuple[Planned, list[Target]], crs97: Unit) -> None:
    plan, targets = row
    check_plan(plan, targets, crs97.limits())
    assert [s.name for s in plan.steps if isinstance(s, Pause)] == ["b"]
    assert plan.clearance >= FAST.line_clearance


def test_lines_are_straight_and_corners_cut_as_allowed(row: tuple[Planned, list[Target]]) -> None:
    plan, targets = row
    T = {r.target: r.T_base_tool for r in plan.reached}

    def tool(name: str) -> np.ndarray:
        move = next(m for m in plan.moves if m.name == name)
        q = plan.unit.positions(move.path.sample(0.005))
        return np.stack([plan.robot.T_base_tool(x) for x in q])

    lowering = tool("approach a")
    line = Line(transform(T["a"][:3, :3], T["a"][:3, 3] - 0.05 * T["a"][:3, 2]), T["a"])
    assert line.deviation(lowering).distance.max() < 1e-5
    assert line.deviation(lowering).angle.max() < 1e-4
    cut = tool("line to d .. line to e")[:, :3, 3]
    corner = targets[3].T_base_tool[:3, 3]
    nearest = np.linalg.norm(cut - corner, axis=1).min()
    assert 1e-4 < nearest <= 0.003
    away = [
        Line(targets[i].T_base_tool, targets[i + 1].T_base_tool)
        .deviation(tool("line to d .. line to e"), "z")
        .distance
        for i in (2, 3)
    ]
    assert np.min(away, axis=0).max() < 0.003


def test_the_clearance_is_there_in_mujoco(row: tuple[Planned, list[Target]]) -> None:
    from arm.io.storage import data_file

    plan, _ = row
    bodies = [TABLE, Body("wall", Box((0.4, 0.02, 0.3)), transform(t=(0.5, 0.0, 0.15)), "wall")]
    cell = MujocoCell(data_file("urdf/a465/a465.urdf"), bodies, [], plan.robot.disabled_collisions)
    pairs = [p for p in cell.pairs() if frozenset(p) not in plan.robot.disabled_collisions]
    for move in plan.moves:
        seen = np.inf
        for q in plan.unit.positions(move.path.sample(0.1)):
            cell.place(q, 0.06, {})
            seen = min(seen, *(cell.distance(*pair, 0.2) for pair in pairs))
        assert seen >= move.clearance - 2e-6


def test_the_same_in_the_counts_of_a_unit_and_twice_the_same(robot: Robot, crs97: Unit) -> None:
    targets = [Target("a", down(0.45, -0.2, 0.1), approach=0.05), Target("b", down(0.4, 0.2, 0.2))]
    q = np.radians([-35, -35, -85, 0, -60, 0])

    def made() -> Planned:
        return plan_poses(robot, [TABLE], targets, q, crs97.limits(), unit=crs97, q_end=q, options=FAST)

    plan = made()
    check_plan(plan, targets, crs97.limits(), exact=1e-4)  # whole counts
    assert plan.moves[0].path.start == plan.moves[-1].path.end == tuple(crs97.counts(q).tolist())
    world = AttachmentWorlds(Scene(robot, robot, (TABLE,), ()), targets)
    for move in plan.moves:
        assert certify_move(world.world(world.start), move.path, crs97, move.clearance - 1e-6).proved
    assert json.dumps(plan.to_json()) == json.dumps(made().to_json())
