"""An observation: what is expected after moves of cubes, and how another one differs from that."""

from __future__ import annotations

import numpy as np

from arm.poses import BoardPose
from pictures.boards import lab_board
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy

OCCUPANCY = (
    Occupancy("cube"),
    Occupancy("empty"),
    Occupancy("unsure", reason="something is across it"),
    Occupancy("cube"),
)


def _seen() -> Observation:
    poses = (BoardPose(lab_board(name), np.eye(4), np.eye(6), 0.1, 20.0) for name in ("01-02", "03-04"))
    return Observation(tuple(ObservedBoard(pose, OCCUPANCY) for pose in poses), {"05-06": "not in view"})


def test_holes_by_state_and_boards_by_name() -> None:
    seen = _seen()
    board = seen.board("03-04")
    assert board is seen.boards[1]
    assert [hole.name for hole in board.holes("cube")] == ["03-04/1", "03-04/4"]
    assert [hole.name for hole in board.holes("empty", "unsure")] == ["03-04/2", "03-04/3"]
    assert seen.board("05-06") is None


def test_other_states_of_some_holes_leave_the_rest_as_it_was() -> None:
    seen = _seen()
    other = seen.with_states({"01-02/3": "empty", "table/1": "cube"})
    assert other.boards[0].occupancy == (*OCCUPANCY[:2], Occupancy("empty"), OCCUPANCY[3])
    assert other.boards[1] == seen.boards[1]
    assert other.moved_since == frozenset()


def test_moves_change_what_is_expected_and_differences_are_told() -> None:
    seen = _seen()
    after = seen.with_moves({"cube 01-02/1": "03-04/2"})
    assert after.state("01-02/1") == "empty"
    assert after.state("03-04/2") == "cube"
    assert after.state("01-02/4") == "cube"
    assert after.state("05-06/1") is None
    assert after.state("table/1") is None
    assert seen.moved_since == frozenset()
    assert after.moved_since == {"01-02/1", "03-04/2"}  # the photographs show these as they were before
    again = after.with_moves({"cube 01-02/3": "03-04/4"})
    assert again.moved_since == {"01-02/1", "03-04/2", "01-02/3", "03-04/4"}
    assert after.changed(seen) == ["hole 01-02/1 looks empty, not cube", "hole 03-04/2 looks cube, not empty"]
    assert seen.changed(seen) == []
    unsure = seen.with_moves({})
    assert unsure.changed(after.with_moves({"cube 01-02/3": "03-04/3"})) == [
        "hole 01-02/1 looks cube, not empty",
        "hole 03-04/2 looks empty, not cube",
    ]
