"""The truth about a released cube is that of its own release."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import transform
from cell.files.task import read_task
from cell.report.cubes import CubeRow, judge_release
from cell.sim.cell import CellEvent

BOARD = SimpleNamespace(name="01-02", T_board_hole=lambda hole: transform(t=(0.0, 0.05 * hole, 0.0)))
CELL: Any = SimpleNamespace(
    world=SimpleNamespace(boards=(SimpleNamespace(board=BOARD, T_base_board=transform(t=(0.3, 0.0, 0.1))),))
)


@pytest.mark.parametrize(("task", "target"), [("task1", "table/4"), ("task2", "03-04/1")])
def test_a_cube_that_is_put_back_is_compared_with_its_hole(task: str, target: str) -> None:
    row = CubeRow("01-02/4", target)
    event = CellEvent("placed", "cube 4", transform(t=(0.301, 0.15, 0.12)), "")
    judge_release(read_task(data_file(f"scenes/{task}.toml")), CELL, row, "01-02/4", [event])
    assert row.error == pytest.approx(1e-3)
    assert row.remarks == []


def test_jaws_that_held_nothing_have_no_error() -> None:
    row = CubeRow("01-02/4", "03-04/1", error=1e-3, tilt_error=0.1)
    pushed = CellEvent("pushed", "cube 4", np.eye(4), "")
    judge_release(read_task(data_file("scenes/task2.toml")), CELL, row, "03-04/1", [pushed])
    assert (row.error, row.tilt_error) == (None, None)
