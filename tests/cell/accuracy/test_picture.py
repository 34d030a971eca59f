"""What is drawn over a board is what the budgets say, magnified."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import apply
from cell.accuracy.insertion import PocketFit
from cell.accuracy.picture import FAINT, INK, MAGNIFIED, budget_picture, budget_pictures, drawn_over
from cell.accuracy.placement import PlacementBudget
from cell.config.cell_file import read_cell
from cell.files.task import Task
from vision.observation import Observation

FIT = PocketFit(0.040, 0.044, 0.0)


def _budget(target: str, long_mm: float, short_mm: float, angle_deg: float) -> PlacementBudget:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    axes = np.array([[c, -s], [s, c]])
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = axes @ np.diag([(1e-3 * long_mm) ** 2, (1e-3 * short_mm) ** 2]) @ axes.T
    return PlacementBudget("cube a", "01-02/1", target, covariance, {}, 0.9931)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, -60.0, 90.0])
def test_ellipses_have_the_axes_of_the_offsets(angle_deg: float) -> None:
    """The 95 % ellipse of standard deviations s has half axes of 2.45 s; the room is half of mouth less cube."""
    board = next(b for b in read_cell(data_file("scenes/cell.toml")).boards if b.name == "03-04")
    budgets = [_budget("03-04/3", 0.5, 0.2, angle_deg), _budget("05-06/1", 0.5, 0.2, 0.0)]
    picture = budget_picture(board, budgets, FIT)
    (mark,) = picture.marks  # the other is on another board
    assert (mark.x, mark.y) == pytest.approx(tuple(1e3 * board.holes[2][:2]))
    assert (mark.long, mark.short) == pytest.approx(
        (2.4477 * 0.5 * MAGNIFIED, 2.4477 * 0.2 * MAGNIFIED), rel=1e-4
    )
    assert (mark.angle - angle_deg + 90.0) % 180.0 == pytest.approx(90.0)  # an axis has no direction
    assert mark.room == pytest.approx(2.0 * MAGNIFIED)
    assert (mark.label, mark.title) == ("99.31 %", "cube a to 03-04/3: RMS offset 0.54 mm")
    x, y, width, height = picture.plate
    assert (width, height) == (240.0, 200.0)
    assert (x + width / 2.0, y + height / 2.0) == pytest.approx((90.0, 70.0))


def test_boards_without_placements_have_no_picture() -> None:
    boards = read_cell(data_file("scenes/cell.toml")).boards
    budgets = [_budget("03-04/3", 0.5, 0.2, 0.0), _budget("05-06/1", 0.5, 0.2, 0.0)]
    assert [picture.board for picture in budget_pictures(boards, budgets, FIT)] == ["03-04", "05-06"]
    assert budget_pictures(boards, [], FIT) == []


def test_ellipses_are_drawn_where_the_hole_is_in_the_photograph(task: Task, seen: Observation) -> None:
    camera, blank = task.cell.camera, np.zeros((1200, 1920, 3), dtype=np.uint8)
    budget = _budget("03-04/3", 1.2, 0.3, 0.0)
    drawn = drawn_over(blank.copy(), camera, seen, [budget], FIT)
    hole = next(h for pose in seen.poses for h in pose.holes if h.name == budget.target)
    ends = [[2.4477e-3 * 1.2 * MAGNIFIED, 0.0, 0.0], [0.0, 2.4477e-3 * 0.3 * MAGNIFIED, 0.0]]
    for points, colour in (
        ([*ends, *np.negative(ends)], INK),
        ([[1e-3 * 2.0 * MAGNIFIED, 1e-3 * x, 0.0] for x in (-15.0, 0.0, 15.0)], FAINT),
    ):
        for x, y in np.rint(camera.project_base(apply(hole.T_base_hole, points))).astype(int):
            near = drawn[y - 2 : y + 3, x - 2 : x + 3].reshape(-1, 3)
            assert (np.abs(near.astype(int) - colour).max(axis=1) < 40).any()
    x, y = np.rint(camera.project_base(hole.T_base_hole[:3, 3])).astype(int)
    assert not drawn[y - 5 : y + 6, x - 5 : x + 6].any()
    assert drawn.any(axis=(1, 2)).sum() < 400  # of 1200 rows
