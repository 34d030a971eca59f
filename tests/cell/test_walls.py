"""A wall in the cell file that blocks the straight joint move: the plan goes around it, certified."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.files import data_file
from arm.poses import BoardPose
from cell.lookfile import Seen, SeenBoard
from cell.planning import plan_rest, scene_of
from cell.taskfile import Task, read_task
from cell.worldfile import read_world
from plan.check import check_curve, curve_of_waypoints
from plan.world import World

WALL = '\n[[walls]]\nname = "post"\ncentre_mm = [340, -365, 100]\nsize_mm = [30, 30, 200]\n'


def _truth(task: Task) -> Seen:
    world = read_world(data_file("scenes/task2.world.toml"), 0.036)
    boards = []
    for b in world.boards:
        pose = BoardPose(b.board, b.T_base_board, 1e-8 * np.eye(6), 0.1, 100.0)
        boards.append(SeenBoard(pose, tuple("cube" if hole in b.cubes else "empty" for hole in range(4))))
    return Seen(tuple(boards), {})


def test_a_wall_in_the_way_is_gone_around(scenes: Path) -> None:
    free = read_task(scenes / "task2.toml")
    (scenes / "cell.toml").write_text((scenes / "cell.toml").read_text() + WALL)
    walled = read_task(scenes / "task2.toml")
    plans = [plan_rest(t, _truth(t), t.cell.q_start, 0.5, {}, {}) for t in (free, walled)]
    assert plans[0] is not None
    assert plans[1] is not None
    world = World(walled.cell.robot(), scene_of(walled, _truth(walled), {}).bodies)
    first = next(plans[0].moves)
    ends = walled.cell.unit.positions(first.path.knots()[[0, -1]])
    straight = check_curve(world, curve_of_waypoints(ends), walled.cell.clearance)
    assert not straight.proved
    assert "post" in straight.pair
    for move in plans[1].moves:
        assert move.certified
        assert move.clearance >= (0.010 if move.role in ("transit", "home") else 0.005)
    assert plans[1].duration_s < 1.3 * plans[0].duration_s
