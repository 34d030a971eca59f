"""Errors of holes and of the tool in a calibrated cell; the derivatives are tested in test_placement."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.poses import BoardPose, adjoint
from arm.se3 import inverse, transform
from cell.accuracy.error_model import ErrorModel
from cell.accuracy.linear_error import LinearError
from cell.config.cell import Cell

ROOT = np.diag([5e-5, 6e-5, 4e-4, 3e-3, 3e-3, 4e-4])


def _pose(cell: Cell, share: float | None) -> BoardPose:
    again = None if share is None else share * ROOT @ ROOT
    return BoardPose(cell.boards[0], transform(t=(0.4, 0.0, 0.05)), ROOT @ ROOT, 0.1, 9.0, None, again)


def test_a_cell_needs_a_calibration_with_a_covariance(cell: Cell) -> None:
    assert ErrorModel.available(cell)
    for made in (None, replace(cell.calibration, covariance=None)):  # type: ignore[type-var]
        without = replace(cell, calibration=made)
        assert not ErrorModel.available(without)
        with pytest.raises(ImpossibleError, match="the error of a placement is unknown"):
            ErrorModel.of(without)


@pytest.mark.parametrize("share", [None, 0.0, 0.3, 1.0])
def test_detection_and_print_are_the_looks_covariance(cell: Cell, share: float | None) -> None:
    pose = _pose(cell, share)
    error = ErrorModel.of(cell).board(pose).shared
    to_board = adjoint(inverse(pose.T_base_board))
    found = {name: to_board @ alone @ to_board.T for name, (alone, _) in error.by_source().items()}
    assert found["detection"] == pytest.approx((share or 0.0) * ROOT @ ROOT, abs=1e-14)
    assert found["detection"] + found["board and print"] == pytest.approx(ROOT @ ROOT, abs=1e-14)


def test_holes_of_a_board_share_all_but_the_plates_tolerance(cell: Cell) -> None:
    board = ErrorModel.of(cell).board(_pose(cell, 0.5))
    apart = board.hole(0) - board.hole(3)
    to_hole = adjoint(inverse(mul(board.pose.T_base_board, board.pose.board.T_board_hole(0))))
    made = (board.pose.board.tolerance / 2.0) ** 2
    across = (to_hole @ apart.covariance @ to_hole.T)[:2, :2]
    assert across == pytest.approx(2.0 * made * np.eye(2), abs=1e-14)
    assert board.pose.holes[0].covariance[:2, :2] == pytest.approx(
        _in_hole(board.hole(0), to_hole, "detection", "board and print")[:2, :2], abs=1e-12
    )


def _in_hole(error: LinearError, to_hole: np.ndarray, *sources: str) -> np.ndarray:
    return sum((to_hole @ error.by_source()[name][0] @ to_hole.T for name in sources), np.zeros((6, 6)))


def test_two_arrivals_share_the_arm_and_differ_by_its_scatter(cell: Cell) -> None:
    model, q = ErrorModel.of(cell), np.radians([10.0, -40.0, -80.0, 5.0, -60.0, 20.0])
    again = (model.tool_error(q) - model.tool_error(q)).by_source()
    for name in ("joint offsets", "links", "tool"):
        assert np.abs(again[name][0]).max() < 1e-20
    single = model.tool_error(q).by_source()["repeatability"][0]
    assert again["repeatability"][0] == pytest.approx(2.0 * single)


def test_an_arm_without_scatter_and_a_certain_tool_err_by_the_calibration_alone(cell: Cell) -> None:
    still = replace(cell, calibration=replace(cell.calibration, scatter=None), tool_tolerance=0.0)  # type: ignore[type-var]
    error = ErrorModel.of(still).tool_error(np.full(6, 0.3)).by_source()
    assert {name for name, (alone, _) in error.items() if np.abs(alone).max() > 1e-20} == {"joint offsets"}
