"""Which print of markers an image shows."""

import cv2
import numpy as np
import pytest

from pictures.seen_targets import photograph
from vision.markers.dictionaries import predefined
from vision.targets.marker_print import Layout, MarkerPrint, family, find_layout, squares_of
from vision.targets.target import Target

TILTED = np.array([[60.0, 8.0, 300.0], [-5.0, 55.0, 200.0], [-2e-3, 4e-3, 1.0]])


def outlines_of(squares: np.ndarray) -> np.ndarray:
    """Outlines (n, 4, 2) px of markers of 0.7 squares, seen at an angle."""
    corners = np.array([[0.15, 0.15], [0.85, 0.15], [0.85, 0.85], [0.15, 0.85]])
    flat = (squares[:, None] + corners).reshape(-1, 1, 2).astype(float)
    return cv2.perspectiveTransform(flat, TILTED).reshape(-1, 4, 2)


@pytest.mark.few(3)
@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(5, 5), (7, 5), (6, 4), (10, 14), (9, 6)])
def test_ids_are_in_the_squares_where_opencv_has_them(columns: int, rows: int, legacy: bool) -> None:
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, 0.5, predefined("DICT_4X4_100"))
    board.setLegacyPattern(legacy)
    expected = np.array([np.asarray(m)[:, :2].mean(axis=0) - 0.5 for m in board.getObjPoints()])
    target = Target("charuco", columns, rows, 1.0, 0.5, "DICT_4X4_100", legacy)
    assert target.white_first == (legacy and rows % 2 == 0)
    found = squares_of(np.arange(len(expected)), columns, target.white_first)
    assert np.array_equal(found, np.rint(expected).astype(int))
    assert [tuple(s) for s in found] == target.marker_squares()
    assert find_layout(np.arange(len(found)), outlines_of(found)) == Layout(columns, rows, target.white_first)


def test_a_part_with_a_stray_marker_is_enough_and_loose_markers_are_no_board() -> None:
    ids = np.array([0, 1, 5, 6, 9, 10, 11, 16, 17, 20])
    squares = squares_of(ids, 7, False)
    outlines = outlines_of(squares)
    assert find_layout(ids, outlines) == Layout(7, 6, False)
    stray = np.append(ids, 900), np.concatenate([outlines, outlines[:1] + 37.0])
    assert find_layout(*stray) == Layout(7, 6, False)
    assert find_layout(ids[:5], outlines[:5]) is None  # too few
    loose = outlines + 200.0 * np.random.default_rng(0).uniform(-1.0, 1.0, (len(ids), 1, 2))
    assert find_layout(ids, loose) is None


def test_a_print_is_named_by_the_smallest_dictionary_that_has_it() -> None:
    image, _ = photograph(Target(), 4)
    shown = MarkerPrint.in_image(image, "DICT_5X5_1000")
    assert shown is not None
    assert shown.words() == "17 markers of DICT_5X5_50 (ids 0 to 16) on a board of 7 x 5 squares"
    assert MarkerPrint.in_image(image, "DICT_4X4_50") is None
    assert family("DICT_4X4_250") == "DICT_4X4_"
    assert family("DICT_ARUCO_ORIGINAL") == "DICT_ARUCO_ORIGINAL"
