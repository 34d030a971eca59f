"""The drawing of scenes/pen: the tip stays on the lines at every millisecond, and on the paper."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import inverse
from cell.program.path_step import PathStep
from cell.program.planning import plan_of_program
from cell.program.program_file import read_program
from cell.program.svg import strokes_of
from cell.task.plan_matches import replayed
from vision.observation import Observation

pytestmark = pytest.mark.slow


def test_the_pen_is_on_the_drawn_lines_at_every_millisecond() -> None:
    task = read_program(data_file("scenes/pen/drawing.toml"))
    plan = plan_of_program(task, Observation(), task.cell.speed)
    replayed(task, plan)
    moves = {move.name: move for move in plan.moves}
    robot, unit, T_work_base = task.cell.robot(), task.cell.unit, inverse(task.T_on_work)
    drawn = strokes_of(data_file("scenes/pen/drawing.svg"), 0.210)
    assert len(drawn) == len(task.steps) == 4
    for step, stroke in zip(task.steps, drawn, strict=True):
        assert isinstance(step, PathStep)
        path = moves[f"along {step.name}"].path
        times = np.arange(0.0, path.duration_s, 1e-3)
        tip = np.array([(T_work_base @ robot.T_base_tool(q))[:3, 3] for q in unit.positions(path.at(times))])
        off = np.min([piece.distances(tip) for piece in step.outline.pieces], axis=0)
        assert off.max() < 1e-4
        down = tip[tip[:, 2] < 1e-4]
        from_drawing = np.min([piece.distances(down) for piece in stroke.pieces], axis=0)
        assert (
            np.sort(from_drawing)[int(0.98 * len(down))] < 6e-4
        )  # rounded corners, and about 1 mm at both ends
        speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) / 1e-3
        assert speed.max() < 1.01 * 0.060
