"""Another board with the same ids, of which no marker shows as a whole."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from arm.robot.shapes import Body, Box
from arm.se3 import inverse, transform
from outlined.puzzle import DICTIONARY, PLAIN, PUZZLE, as_designed, corners_of, lying, picture, view_of, wire
from vision.boards.copies import other_copy
from vision.markers.detect import detect_markers
from vision.markers.edge_profiles import Grey

FIRST, SECOND = lying((0.46, -0.09, 0.031), 20.0, 0.0, 0.0), lying((0.44, 0.10, 0.033), 95.0, 0.0, 0.0)
CAMERA = view_of(np.vstack([corners_of(FIRST), corners_of(SECOND)]))
T_CAMERA = inverse(CAMERA.T_base_camera) @ FIRST


def covers() -> list[Body]:
    """Bars over a third of each marker of the second board, and over all of marker 2 of the first."""
    boxes = [(FIRST, 1, 0.0, 0.046), (SECOND, 0, -0.014, 0.012), (SECOND, 1, 0.014, 0.012)]
    return [
        Body(
            f"bar {k}",
            Box((width, 0.05, 0.002)),
            T @ transform(t=PUZZLE.marker_corners()[number].mean(axis=0) + (aside, 0.0, 0.004)),
            "wire",
        )
        for k, (T, number, aside, width) in enumerate(boxes)
    ]


@lru_cache(maxsize=2)
def drawn(two: bool) -> Grey:
    boards = [(as_designed(), T) for T in (FIRST, SECOND)[: 1 + two]]
    bodies = covers() if two else [*covers()[:1], *wire("d", FIRST)]
    image = picture(CAMERA, boards, PLAIN, np.random.default_rng(1), bodies)
    assert [m.id for m in detect_markers(image, CAMERA, DICTIONARY)] == [1]
    return np.asarray(image, dtype=np.float32)


def test_what_remains_of_another_board_s_markers_is_told_with_its_place() -> None:
    doubt = other_copy(drawn(True), PUZZLE, T_CAMERA, CAMERA, DICTIONARY)
    assert doubt is not None
    marker = PUZZLE.marker_ids.index(doubt.data["marker"])
    true = CAMERA.project_base(SECOND[:3, :3] @ PUZZLE.marker_corners()[marker].mean(axis=0) + SECOND[:3, 3])
    assert np.linalg.norm(true - doubt.data["marker_px"]) < 20.0
    assert "another board with the same ids is in view" in str(doubt)
    assert "\n" not in str(doubt)


def test_a_board_alone_has_no_copy_whatever_of_its_own_markers_shows() -> None:
    assert other_copy(drawn(False), PUZZLE, T_CAMERA, CAMERA, DICTIONARY) is None


def test_markers_of_boards_with_other_ids_are_no_copies() -> None:
    """They look somewhat alike: all have a black frame."""
    other = replace(PUZZLE, name="03-04", marker_ids=(3, 4))
    assert other_copy(drawn(True), other, T_CAMERA, CAMERA, DICTIONARY, others=(1, 2)) is None
