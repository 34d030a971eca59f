"""Calibration targets: their files, their corners in an image, and what a photograph of one is worth."""

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from cell.sim.target_photos import photograph_target, target_pose
from pictures.seen_targets import BOARD, CAMERA, photograph
from vision.targets.target import Target, TargetFinder, read_target

CHESS = Target("checkerboard", 9, 6, 0.025, 0.0, "")


def errors(target: Target, view, T):
    """Of the corners, (n, 2) px."""
    return view.corners_px - CAMERA.project(target.points()[view.ids] @ T[:3, :3].T + T[:3, 3])


@pytest.mark.parametrize(("target", "count"), [(BOARD, 4), (CHESS, 2)], ids=["charuco", "checkerboard"])
def test_corners_are_found_where_they_are(target, count):
    finder = TargetFinder(target)
    off = []
    for seed in range(count):
        image, T = photograph(target, seed)
        view = finder.find(image)
        assert view is not None
        assert len(view.ids) >= 0.8 * target.corners
        off.append(errors(target, view, T))
    pooled = np.concatenate(off)
    assert np.sqrt(np.mean(pooled**2)) < 0.04
    assert np.abs(pooled.mean(axis=0)).max() < 0.01


@pytest.mark.parametrize("roll_deg", [0, 90, 180, 270])
def test_a_checkerboard_is_told_from_its_half_turn(roll_deg):
    image, T = photograph(CHESS, 7, roll=float(np.radians(roll_deg)))
    view = TargetFinder(CHESS).find(image)
    assert view is not None
    assert np.abs(errors(CHESS, view, T)).max() < 0.2


def test_a_target_that_is_cut_off_gives_the_corners_that_are_there():
    rng = np.random.default_rng(3)
    T = target_pose(CAMERA, BOARD, np.array([250.0, 600.0]), 1.0, np.array([0.1, 0.2]), 0.0)
    view = TargetFinder(BOARD).find(photograph_target(CAMERA, BOARD, T, rng))
    assert view is not None
    assert 6 <= len(view.ids) < BOARD.corners
    assert np.abs(errors(BOARD, view, T)).max() < 0.2


def test_no_target_is_none_and_another_dictionary_is_named():
    other = Target(dictionary="DICT_4X4_50")
    image, _ = photograph(other, 4)
    finder = TargetFinder(BOARD)
    assert finder.find(image) is None
    assert "DICT_4X4_50" in finder.seen_instead(image)
    empty = np.full((1200, 1920), 128, dtype=np.uint8)
    assert finder.find(empty) is None
    assert finder.seen_instead(empty) == ""


def test_a_mirrored_target_is_named_and_a_stray_marker_is_not():
    image, _ = photograph(BOARD, 12)
    finder = TargetFinder(BOARD)
    mirrored = np.ascontiguousarray(image[:, ::-1])
    assert finder.find(mirrored) is None
    assert finder.seen_instead(mirrored).startswith("its mirror image")
    stray = np.full((300, 300), 255, dtype=np.uint8)
    marker = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(3, 120)
    stray[90:210, 90:210] = marker
    assert finder.seen_instead(stray) == ""


def test_files_are_read_and_their_mistakes_named(tmp_path):
    def read(text: str) -> Target:
        file = tmp_path / "target.toml"
        file.write_text(text)
        return read_target(file)

    full = 'squares = [7, 5]\nsquare_mm = 30\nmarker_mm = 22\ndictionary = "DICT_5X5_100"\n'
    assert read(full) == BOARD
    assert read('kind = "checkerboard"\nsquares = [9, 6]\nsquare_mm = 25\n') == CHESS
    for text, key, rule in (
        (full.replace("marker_mm = 22", "marker_mm = 30"), "marker_mm", "must be less than square_mm = 30"),
        (full.replace("DICT_5X5_100", "DICT_5X5_10"), "dictionary", "must be one of"),
        (full.replace("[7, 5]", "[40, 40]"), "squares", "need 800 markers; DICT_5X5_100 has 100"),
        (full.replace("[7, 5]", "[7]"), "squares", "must be 2 whole numbers"),
        (full + "colour = 1\n", "colour", "is not a known key"),
        ('kind = "checkerboard"\nsquares = [8, 6]\nsquare_mm = 25\n', "squares", "rotated by 180 deg"),
    ):
        with pytest.raises(InputError, match=rule) as caught:
            read(text)
        assert caught.value.data["key"] == key


def test_the_target_frame_is_opencvs():
    board = cv2.aruco.CharucoBoard(
        (7, 5), 0.030, 0.022, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    assert BOARD.points() == pytest.approx(np.asarray(board.getChessboardCorners()).reshape(-1, 3), abs=1e-7)
    centres = [np.asarray(m).mean(axis=0) for m in board.getObjPoints()]
    squares = [(0.030 * (i + 0.5), 0.030 * (j + 0.5)) for i, j in BOARD.marker_squares()]
    assert np.array(squares) == pytest.approx(np.array(centres)[:, :2], abs=1e-6)
