"""What stands on a board counts in whether it has moved: the tip of a tall wire moves further than the plate."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.poses import BoardPose
from arm.se3 import Array, apply, rotation, transform
from cell.files.board_shift import board_shift, moved_boards
from cell.program.planning import program_scene
from cell.program.program_file import ProgramTask, read_program
from cell.task.plan_matches import require_scene
from cell.task.programs import resume
from plan.collision.covers import hull
from vision.observation import Observation, ObservedBoard

T_BOARD = transform(t=(0.45, 0.0, 0.05))


@pytest.fixture(scope="module")
def task() -> ProgramTask:
    return read_program(data_file("scenes/hoop/seen.toml"))


def seen(task: ProgramTask, T: Array) -> Observation:
    assert task.board is not None
    return Observation((ObservedBoard(BoardPose(task.board, T, np.eye(6), 0.1, 9.0), ()),))


def tilted(task: ProgramTask, degrees: float) -> Array:
    """The board turned about an axis in its plate, through its middle."""
    assert task.board is not None
    x, y = task.board.plate.centre
    about = transform(t=(x, y, 0.0))
    return np.asarray(
        T_BOARD @ about @ transform(rotation((np.radians(degrees), 0.0, 0.0))) @ np.linalg.inv(about)
    )


def test_the_boxes_contain_the_bodies_of_the_workpiece(task: ProgramTask) -> None:
    low, high = task.on_board.min(axis=0), task.on_board.max(axis=0)
    assert high[2] > 0.15
    for body in task.bodies_at(task.T_on_work):
        points, radius = hull(body.shape)
        at = apply(body.T_base_body, points)
        assert (at - radius >= low - 0.01).all()
        assert (at >= low - 1e-9).all()
        assert (at <= high + 1e-9).all()


def test_a_tilt_that_the_plate_hardly_shows_is_told_by_the_wire(
    task: ProgramTask, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a plan's scene is compared with a look, a look with the next one, and a stopped plan with what is seen."""
    assert task.board is not None
    cell, now = task.cell, tilted(task, 0.9)
    assert not board_shift(task.board, cell.cube_size, T_BOARD, now).beyond(cell)
    before = seen(task, T_BOARD)
    plan: Any = SimpleNamespace(scene=program_scene(task, before).to_json())
    require_scene(task, plan, before)
    assert moved_boards(before, before, task) == []
    with pytest.raises(ImpossibleError, match=r"plate 01-02 is .* from its planned pose"):
        require_scene(task, plan, seen(task, now))
    (line,) = moved_boards(before, seen(task, now), task)
    assert "board 01-02 moved by" in line
    monkeypatch.setattr(resume, "scene_of_now", lambda *_: None)
    monkeypatch.setattr(resume, "planned_observation", lambda *_: before)
    run: Any = SimpleNamespace(task=task, see=lambda *_, **more: seen(task, now), tell=print)
    with pytest.raises(ImpossibleError, match=r"board 01-02 is .* from its planned pose"):
        resume._require_boards(run, plan)
