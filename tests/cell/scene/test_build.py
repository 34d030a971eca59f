"""Scenes built of what was seen: padding covers the tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.plan_file import Plan
from arm.poses import BoardPose
from arm.se3 import Array, frozen, rotation, transform
from cell.files.board_shift import board_shift
from cell.files.task import Task
from cell.program.program_file import read_program
from cell.scene.build import board_bodies, build_scene
from plan.collision.certificate import certify_move
from plan.collision.world import World
from plan.verify import move_scenes
from tasks.seen_cells import with_pose
from vision.observation import Observation

pytestmark = pytest.mark.xdist_group("checking")


def _moved(T: Array, cell_moved: float, rng: np.random.Generator, task: Task, name: str) -> Array:
    """The pose of a board, shifted and turned at random as far as `cell_moved` allows."""
    board = next(b for b in task.cell.boards if b.name == name)
    twist = rng.normal(size=6) * (1.0, 1.0, 1.0, 8.0, 8.0, 8.0)
    low, high = 0.0, 0.1
    for _ in range(40):  # bisection on the size of the motion
        middle = (low + high) / 2.0
        step = transform(rotation(middle * twist[3:]), middle * twist[:3])
        now = frozen(T @ step)
        shift = board_shift(board, task.cell.cube_size, T, now)
        low, high = (middle, high) if shift.farthest <= cell_moved else (low, middle)
    return frozen(T @ transform(rotation(low * twist[3:]), low * twist[:3]))


@pytest.mark.slow
def test_wherever_boards_are_within_the_tolerance_the_certificate_holds(
    task: Task, plan: Plan, seen: Observation
) -> None:
    """Boards, stands and cubes stand elsewhere by all that is not noticed: the plan's clearances are still true."""
    rng, cell = np.random.default_rng(4), task.cell
    worst = np.inf
    for _ in range(3):
        moved = seen
        for p in seen.poses:
            moved = with_pose(
                moved, p.board.name, _moved(p.T_base_board, cell.moved, rng, task, p.board.name)
            )
        exact = replace(cell, moved=0.0)
        truth = build_scene(exact, moved)
        by_name = {b.name: b for b in (*truth.bodies, *truth.cubes)}
        stated = build_scene(cell, seen)
        stated = replace(stated, allowed=frozenset(frozenset(pair) for pair in plan.scene["allowed"]))
        for move, _, resting in move_scenes(plan, stated, cell.unit):
            if move.held is not None or any(c.name not in by_name for c in resting):
                continue
            where = {c.name: c.T_base_body for c in stated.cubes}
            standing = [
                by_name[c.name] if np.array_equal(c.T_base_body, where[c.name]) else replace(c, padding=0.0)
                for c in resting
            ]
            world = World(truth.robot_open, [*truth.bodies, *standing])
            found = certify_move(world, move.path, cell.unit, move.clearance - 1e-6, tight=False)
            assert found.proved, (move.name, found)
            worst = min(worst, found.seen - move.clearance)
    assert worst < 4e-3  # the tolerance was used, and not much more than it was taken off


def test_stands_move_no_further_than_they_are_padded(task: Task, seen: Observation) -> None:
    rng, cell = np.random.default_rng(5), task.cell
    for pose in seen.poses:
        before = {b.name: b for b in board_bodies(cell, [pose])}
        for _ in range(40):
            moved = replace(
                pose, T_base_board=_moved(pose.T_base_board, cell.moved, rng, task, pose.board.name)
            )
            for body in board_bodies(cell, [moved]):
                old = before[body.name]
                corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
                then, now = (
                    corners * b.shape.size @ b.T_base_body[:3, :3].T + b.T_base_body[:3, 3]  # type: ignore[union-attr]
                    for b in (old, body)
                )
                if (
                    body.kind == "stand"
                ):  # its height follows the plate's lowest edge; its foot stays on the table
                    then, now = then[:, :2], now[:, :2]
                assert np.linalg.norm(now - then, axis=1).max() <= old.padding + 1e-9


def test_a_stand_larger_than_its_plate_is_padded_by_more() -> None:
    """By sqrt(1 + k^2) of what the plate may move, k the ratio of their edges: more than the usual 1.5."""
    cell = read_program(data_file("scenes/hoop/seen.toml")).cell
    (board,) = cell.boards
    larger = max(np.array(cell.stand_size) / board.plate.size[:2])
    assert larger > 1.12
    pose = BoardPose(board, transform(t=(0.45, 0.0, 0.05)), np.eye(6), 0.1, 9.0)
    plate, stand = board_bodies(cell, [pose])
    assert plate.padding == cell.moved
    assert stand.padding >= np.sqrt(1.0 + larger**2) * cell.moved
