"""Calibration targets: their files, their corners in an image, and what a photograph of one is worth."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from cell.sim.target_photos import photograph_target, target_pose
from pictures.seen_targets import BOARD, CAMERA, photograph
from vision.markers.dictionaries import predefined
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


@pytest.mark.few(2)
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
    loose = np.full((400, 400), 255, np.uint8)
    for k, (x, y) in enumerate([(40, 40), (220, 60), (90, 250), (260, 270)]):
        loose[y : y + 90, x : x + 90] = cv2.aruco.generateImageMarker(predefined("DICT_4X4_50"), k, 90)
    assert "4 markers of DICT_4X4_50 (ids 0 to 3): give images of the target, or" in finder.seen_instead(
        loose
    )
    assert finder.seen_instead(loose, loose=False) == ""
    empty = np.full((1200, 1920), 128, dtype=np.uint8)
    assert finder.find(empty) is None
    assert finder.seen_instead(empty) == ""


@pytest.mark.slow
def test_a_legacy_board_is_read_with_its_key_and_named_without_it():
    """Nothing of it is read by a finder of the other layout; the message names every key that differs."""
    legacy = Target("charuco", 6, 4, 0.030, 0.022, "DICT_5X5_100", legacy=True)
    image, T = photograph(legacy, 5)
    view = TargetFinder(legacy).find(image)
    assert view is not None
    assert np.abs(errors(legacy, view, T)).max() < 0.2
    image = np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
    other = TargetFinder(replace(legacy, legacy=False))
    assert other.find(image) is None
    said = other.seen_instead(image)
    assert "12 markers of DICT_5X5_50 (ids 0 to 11) on a board of 6 x 4 squares in the legacy layout" in said
    assert said.endswith(": the file of --target needs legacy = true")
    said = TargetFinder(replace(BOARD, dictionary="DICT_4X4_50")).seen_instead(image)
    assert said.endswith('needs squares = [6, 4], dictionary = "DICT_5X5_50", legacy = true')
    assert (
        TargetFinder(CHESS)
        .seen_instead(image)
        .endswith('needs kind = "charuco", squares = [6, 4], dictionary = "DICT_5X5_50", legacy = true')
    )
    assert (
        TargetFinder(legacy)
        .seen_instead(image)
        .endswith("too blurred for its corners; take it nearer, and in focus")
    )


@pytest.mark.slow
def test_a_target_that_is_a_part_of_a_larger_print_is_told():
    image, _ = photograph(BOARD, 4)
    part = TargetFinder(replace(BOARD, rows=3))
    assert len(part.find(image).ids) == part.target.corners
    said = part.read_in_part(image)
    assert "17 markers of DICT_5X5_50 (ids 0 to 16) on a board of 7 x 5 squares" in said
    assert said.endswith("needs squares = [7, 5]")
    assert TargetFinder(BOARD).read_in_part(image) == ""
    assert TargetFinder(replace(BOARD, rows=7)).read_in_part(image) == ""
    assert TargetFinder(CHESS).read_in_part(image) == ""


def test_a_checkerboard_whose_inner_corners_were_counted_is_told() -> None:
    image, _ = photograph(CHESS, 2)
    counted = TargetFinder(replace(CHESS, columns=CHESS.columns - 1, rows=CHESS.rows - 1))
    assert counted.find(image) is None
    assert counted.seen_instead(image) == (
        "one of 8 x 5 inner corners: the file of --target needs squares = [9, 6], which counts squares"
    )
    other = TargetFinder(replace(CHESS, columns=12, rows=11))
    assert re.match(r"a checkerboard of about \d+ x \d+ squares: count them", other.seen_instead(image))
    assert TargetFinder(CHESS).seen_instead(np.full((300, 300), 128, np.uint8)) == ""


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
    assert read(full + "legacy = true\n") == replace(BOARD, legacy=True)
    assert read('kind = "checkerboard"\nsquares = [9, 6]\nsquare_mm = 25\n') == CHESS
    for text, key, rule in (
        (full.replace("marker_mm = 22", "marker_mm = 30"), "marker_mm", "must be less than square_mm = 30"),
        (full.replace("DICT_5X5_100", "DICT_5X5_10"), "dictionary", "must be one of"),
        (full.replace("[7, 5]", "[40, 40]"), "squares", "need 800 markers; DICT_5X5_100 has 100"),
        (full.replace("[7, 5]", "[7]"), "squares", "must be 2 whole numbers"),
        (full + "legacy = 1\n", "legacy", "must be true or false"),
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
