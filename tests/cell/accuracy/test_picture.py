"""What is drawn over a board is what the budgets say, magnified."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from cell.accuracy.insertion import PocketFit
from cell.accuracy.picture import MAGNIFIED, budget_picture
from cell.accuracy.placement import PlacementBudget
from cell.config.cell_file import read_cell

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
