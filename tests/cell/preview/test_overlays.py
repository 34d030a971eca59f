"""Shapes, markers and executed motions as a page draws them."""

import json
from dataclasses import replace

import numpy as np
import pytest

import arm.board
from arm.errors import InputError
from arm.robot.shapes import Capsule, Torus, convex
from cell.preview.content import page_content
from cell.preview.overlays import ExecutedMove, marker_rows, shape_numbers
from pages.content import matrix


def test_boards_stand_where_their_plates_do(preview_case) -> None:
    boards = [place.board for place in preview_case.boards]
    content = page_content(
        preview_case.plan,
        preview_case.robot_open,
        preview_case.robot_holding,
        preview_case.unit,
        boards=[*boards, replace(boards[0], name="09-10")],
    )
    assert [b["name"] for b in content["boards"]] == ["01-02", "03-04"]  # 09-10 is known, but not there
    for drawn, place in zip(content["boards"], preview_case.boards, strict=True):
        assert np.abs(matrix(drawn["T"]) - place.T_base_board).max() < 1e-6
        assert drawn["markers"][1]["centre"] == pytest.approx(arm.board.SECOND_MARKER)


def test_hulls_are_drawn_with_triangles_that_close() -> None:
    drawn = shape_numbers(convex([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1), (0.02, 0.02, 0.02)]))
    assert len(drawn["convex"]) == 4
    assert sorted(i for face in drawn["faces"] for i in face) == sorted([0, 1, 2, 3] * 3)
    assert shape_numbers(Capsule(0.1, 0.2)) == {"capsule": [0.1, 0.2]}
    assert shape_numbers(Torus(0.1, 0.02)) == {"torus": [0.1, 0.02]}


def test_marker_rows_are_opencvs() -> None:
    rows = marker_rows("DICT_4X4_50", 0)
    # the dictionary's marker 0, a known pattern, inside a black border
    assert rows == ["000000", "010110", "001010", "000110", "000100", "000000"]
    with pytest.raises(InputError, match=r"marker id = 50: must be from 0 to 49 in DICT_4X4_50"):
        marker_rows("DICT_4X4_50", 50)
    with pytest.raises(InputError, match=r"dictionary = 'CORNER_REFINE_NONE': must be one of .*DICT_4X4_50"):
        marker_rows("CORNER_REFINE_NONE", 0)


def test_executed_motion_is_whole_counts(preview_case) -> None:
    first = next(preview_case.plan.moves)
    executed = ExecutedMove(1, np.array([0.0, 0.1]), first.path.at([0.0, 0.1]))
    content = page_content(
        preview_case.plan,
        preview_case.robot_open,
        preview_case.robot_holding,
        preview_case.unit,
        executed=[executed],
    )
    assert content["executed"][0]["counts"][0] == list(first.path.start)
    json.dumps(content, allow_nan=False)
