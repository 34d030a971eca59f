"""A whole look on full photographs: two boards, cubes, what is missing, what is refused."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest

from arm.board import Board, Outline, Plate
from arm.errors import ImpossibleError, InputError
from arm.poses import BoardPose
from arm.robot.shapes import Body, Box
from arm.se3 import apply, transform
from outlined.puzzle import PLAIN, PUZZLE, as_designed, corners_of, lying, picture, view_of
from pictures.boards import (
    CUBE,
    Photographed,
    lab_board,
    lab_camera,
    leaning,
    photograph,
    random_pose,
    smaller,
    twist_between,
    window,
)
from vision.background.camera_shift import CameraShift
from vision.boards.checks import BoardLimits
from vision.markers.dictionaries import predefined
from vision.observe import annotated, look, with_camera_uncertainty
from vision.occupancy.classify import OUT

CAMERA = lab_camera()
A, B, C = lab_board("01-02"), lab_board("03-04"), lab_board("05-06")
DICTIONARY = "DICT_4X4_50"


@lru_cache(maxsize=1)
def two_boards() -> Photographed:
    """The default pair: 7 and 15 deg at different heights, cubes in some holes."""
    return photograph(
        CAMERA,
        [
            (A, leaning((0.46, 0.11, 0.04), 175.0, 7.0, 265.0)),
            (B, leaning((0.46, -0.13, 0.09), 90.0, 15.0, 270.0)),
        ],
        np.random.default_rng(1),
        count=5,
        cubes={A.name: [True, True, False, True], B.name: [False, False, True, False]},
    )


def test_two_boards_and_one_that_is_not_there() -> None:
    shot = two_boards()
    seen = look(shot.images, CAMERA, [A, C, B], DICTIONARY, CUBE)
    assert [p.board.name for p in seen.poses] == ["01-02", "03-04"]
    assert seen.missing == {"05-06": "neither of its markers 5 and 6 is in view"}
    assert seen.half_seen == ()
    assert all(a is b for a, b in zip(seen.images, shot.images, strict=True))
    assert len(seen.frames) == 5
    for board, placed in zip(seen.boards, shot.placed, strict=True):
        pose = board.pose
        twist = twist_between(pose.T_base_board, placed.T_base_board)
        assert np.linalg.norm(twist[:3]) < 0.15e-3
        assert np.linalg.norm(twist[3:]) < np.radians(0.1)
        assert twist @ np.linalg.solve(pose.covariance, twist) < 22.5  # chi-square with 6, 0.1 %
        assert pose.residual_px < 0.03
        assert pose.hypothesis_ratio > 10.0
        states = [o.state for o in board.occupancy]
        assert states == ["cube" if c else "empty" for c in shot.cubes[pose.board.name]]


def test_mirrored_images_are_told_as_such() -> None:
    mirrored = [np.ascontiguousarray(image[:, ::-1]) for image in two_boards().images]
    with pytest.raises(ImpossibleError, match=r"the images are mirrored \(left and right exchanged\)"):
        look(mirrored, CAMERA, [A, C, B], DICTIONARY, CUBE)
    assert look(mirrored, CAMERA, [C], DICTIONARY, CUBE).missing == {
        "05-06": "neither of its markers 5 and 6 is in view"
    }
    assert look([np.full_like(mirrored[0], 90)], CAMERA, [A], DICTIONARY, CUBE).boards == ()


def test_negatives_are_told_as_such() -> None:
    negatives = [255 - image for image in two_boards().images]
    with pytest.raises(
        ImpossibleError, match="negatives: markers are found with black and white exchanged alone"
    ):
        look(negatives, CAMERA, [A, B], DICTIONARY, CUBE)


def test_markers_of_another_dictionary_are_told() -> None:
    target = np.full((1200, 1920), 200, np.uint8)
    board = cv2.aruco.CharucoBoard((7, 5), 0.02, 0.015, predefined("DICT_5X5_100"))
    target[100:1100, 260:1660] = board.generateImage((1400, 1000))
    missing = look([target], CAMERA, [A], DICTIONARY, CUBE).missing
    assert missing == {
        "01-02": "neither of its markers 1 and 2 is in view, but 17 markers of DICT_5X5_50 (ids 0 to 16) on a board of "
        "7 x 5 squares are: is this the target of a calibration? boards have DICT_4X4_50 (boards.dictionary)"
    }


def test_boards_of_another_dictionary_than_the_cell_file_states_are_told() -> None:
    assert look(two_boards().images, CAMERA, [A], "DICT_5X5_50", CUBE).missing == {
        "01-02": "neither of its markers 1 and 2 is in view, but 4 markers of DICT_4X4_50 (ids 1 to 4) are: are "
        "the boards of these? boards.dictionary is DICT_5X5_50"
    }


def test_the_picture_shows_what_was_found_and_leaves_the_photograph_alone() -> None:
    shot = two_boards()
    seen = look(shot.images, CAMERA, [A, B], DICTIONARY, CUBE)
    before = shot.images[0].copy()
    picture = annotated(shot.images[0], CAMERA, seen)
    assert picture.shape == (1200, 1920, 3)
    assert np.array_equal(before, shot.images[0])
    drawn = (picture != before[..., None]).any(axis=-1)
    for pose in seen.poses:
        for u, v in np.rint(CAMERA.project_base(pose.T_base_board[:3, 3])[None]).astype(int):
            assert drawn[v - 10 : v + 10, u - 10 : u + 10].any()
    colour = np.repeat(before[..., None], 3, axis=-1)
    assert np.array_equal(annotated(colour, CAMERA, seen), picture)
    assert np.array_equal(colour[..., 0], before)


def test_a_marker_that_belongs_to_no_board() -> None:
    with pytest.raises(
        InputError, match=r"marker 3, 4 is in view but belongs to no board .*known: 1, 2, 5, 6"
    ) as e:
        look(two_boards().images, CAMERA, [A, C], DICTIONARY, CUBE)
    assert e.value.data["markers"] == [3, 4]


def test_a_board_with_one_hidden_marker_is_missing_with_its_reason() -> None:
    shot = two_boards()
    u, v = np.rint(CAMERA.project_base(shot.placed[0].T_base_board[:3, 3])).astype(int)
    images = [image.copy() for image in shot.images]
    for image in images:
        image[max(0, v - 40) : v + 40, u - 40 : u + 40] = 90
    seen = look(images, CAMERA, [A, B], DICTIONARY, CUBE)
    assert seen.missing == {
        "01-02": "marker 1 is hidden, or less than 3 px inside the image; marker 2 alone does not determine "
        "the tilt"
    }
    assert [p.board.name for p in seen.poses] == ["03-04"]
    assert seen.half_seen == ("01-02",)


def test_a_wrong_marker_size_stops_the_look() -> None:
    with pytest.raises(ImpossibleError, match=r"marker size = 35 mm .*36\.0\d mm does"):
        look(two_boards().images, CAMERA, [lab_board("01-02", 0.035), B], DICTIONARY, CUBE)


def test_a_board_that_the_arm_may_cover_is_missing_with_its_reason() -> None:
    """What stops a look otherwise: the other board is still found."""
    shot = two_boards()
    seen = look(shot.images, CAMERA, [lab_board("01-02", 0.035), B], DICTIONARY, CUBE, arm_in_view=True)
    assert [p.board.name for p in seen.poses] == [B.name]
    assert "marker size" in seen.missing[A.name]


@pytest.mark.slow
def test_a_board_outside_the_region_of_the_lens_is_refused() -> None:
    shot = two_boards()
    known = look(shot.images[:1], CAMERA, [A, B], DICTIONARY, CUBE)
    right = max(m.corners_px[:, 0].max() for m in known.frames[0] if m.id in A.marker_ids)
    camera = replace(CAMERA, region=(0.0, 0.0, right - 5.0, 1200.0))
    with pytest.raises(
        ImpossibleError, match=r"board 01-02: a corner of marker \d is at .* px only"
    ) as caught:
        look(shot.images[:1], camera, [A, B], DICTIONARY, CUBE)
    assert caught.value.data["region_px"] == list(camera.region or ())
    seen = look(shot.images[:1], camera, [A, B], DICTIONARY, CUBE, arm_in_view=True)
    assert "calibrate the lens for the whole image" in seen.missing["01-02"]
    within = replace(CAMERA, region=(0.0, 0.0, 1920.0, 1200.0))
    assert len(look(shot.images[:1], within, [A, B], DICTIONARY, CUBE).poses) == 2


def test_bad_photographs() -> None:
    with pytest.raises(InputError, match="at least one image"):
        look([], CAMERA, [A], DICTIONARY, CUBE)
    wrong = [two_boards().images[0], np.zeros((600, 960), np.uint8)]
    with pytest.raises(InputError, match=r"image 2 of 2: is 960 x 600 px.*1920 x 1200"):
        look(wrong, CAMERA, [A, B], DICTIONARY, CUBE)


def test_a_board_that_is_refused_in_a_blurred_image_is_told_the_blur() -> None:
    shot = two_boards()
    strict = BoardLimits(sideways_m=1e-6)
    with pytest.raises(ImpossibleError, match="is too uncertain to grasp") as sharp:
        look(shot.images[:1], CAMERA, [A, B], DICTIONARY, CUBE, strict)
    assert "blurred" not in str(sharp.value)
    blurred = [cv2.GaussianBlur(shot.images[0], (0, 0), 4.0)]
    with pytest.raises(
        ImpossibleError, match=r"; image 1 is blurred by \d\.\d px \(at most 1.5\): focus, or"
    ) as told:
        look(blurred, CAMERA, [A, B], DICTIONARY, CUBE, strict)
    assert told.value.data.keys() == sharp.value.data.keys()


def test_one_marker_twice() -> None:
    camera = smaller(CAMERA, 0.5)
    shot = photograph(camera, [(A, random_pose(np.random.default_rng(2), 0.0))], np.random.default_rng(2))
    image = shot.images[0]
    u, v = np.rint(camera.project_base(shot.placed[0].T_base_board[:3, 3])).astype(int)
    patch = image[v - 55 : v + 55, u - 55 : u + 55].copy()
    image[:110, :110] = patch
    with pytest.raises(InputError, match="marker 1 is in view twice"):
        look([image], camera, [A], DICTIONARY, CUBE)


@lru_cache(maxsize=1)
def at_the_left() -> tuple[Photographed, int]:
    """A board squared to the image, and the first column of its leftmost black corner."""
    T = leaning((0.46, -0.015, 0.05), 0.0, 0.0, 0.0)
    shot = photograph(CAMERA, [(A, T)], np.random.default_rng(3), cubes={A.name: [True, False, True, False]})
    corners = CAMERA.project_base(apply(T, A.marker_corners().reshape(8, 3)))
    return shot, int(np.floor(corners[:, 0].min()))


@pytest.mark.parametrize("margin", [20, 9, 3])
def test_a_board_at_the_edge_of_the_image_is_judged_by_what_is_in_it(margin: int) -> None:
    """Its white border leaves the image; a hole beside the marker may be cut, the others must not suffer."""
    shot, left = at_the_left()
    first = left - margin
    camera = window(CAMERA, (first, 0), (CAMERA.size[0] - first, CAMERA.size[1]))
    seen = look([shot.images[0][:, first:].copy()], camera, [A], DICTIONARY, CUBE)
    told = [(o.state, o.reason) for o in seen.boards[0].occupancy]
    assert told[:3] == [("cube", ""), ("empty", ""), ("cube", "")]
    assert told[3] in (("empty", ""), ("unsure", OUT))  # its mouth begins 16 px further out than the marker
    twist = twist_between(seen.poses[0].T_base_board, shot.placed[0].T_base_board)
    assert np.linalg.norm(twist[:3]) < 0.3e-3


@pytest.mark.parametrize("cut", [0, 4])
def test_a_marker_that_the_edge_of_the_image_cuts_is_not_measured(cut: int) -> None:
    """Its corners would be pixels off; the reason says where it stands."""
    shot, left = at_the_left()
    first = left + cut
    camera = window(CAMERA, (first, 0), (CAMERA.size[0] - first, CAMERA.size[1]))
    seen = look([shot.images[0][:, first:].copy()], camera, [A], DICTIONARY, CUBE)
    assert "marker 1 is hidden, or less than 3 px inside the image" in seen.missing[A.name]


def test_a_pattern_that_passes_for_a_marker_in_one_photograph_of_five_is_clutter() -> None:
    """In three of five it is a marker: its board is not in the cell file."""
    shot = two_boards()
    clear = [image.copy() for image in shot.images]
    outlines = CAMERA.project_base(apply(shot.placed[1].T_base_board, B.marker_corners().reshape(8, 3)))
    for image in clear:
        for outline in outlines.reshape(2, 4, 2):
            u, v = np.rint(outline.mean(axis=0)).astype(int)
            image[v - 30 : v + 30, u - 30 : u + 30] = 90
    for count in (1, 2, 3):
        mixed = [*shot.images[:count], *clear[count:]]
        if count < 3:
            assert [p.board.name for p in look(mixed, CAMERA, [A], DICTIONARY, CUBE).poses] == [A.name]
        else:
            with pytest.raises(InputError, match="marker 3, 4 is in view but belongs to no board"):
                look(mixed, CAMERA, [A], DICTIONARY, CUBE)


@pytest.mark.parametrize("brightest", [0, 17])
def test_black_photographs_are_told_as_such(brightest: int) -> None:
    images = [np.full((1200, 1920), grey, np.uint8) for grey in (0, brightest)]
    with pytest.raises(ImpossibleError, match=f"nothing brighter than {brightest} of 255: expose longer"):
        look(images, CAMERA, [A], DICTIONARY, CUBE)
    white = [np.full((1200, 1920), 255, np.uint8)]
    with pytest.raises(
        ImpossibleError, match="almost nothing but white: 100 % is saturated; reduce exposure"
    ):
        look(white, CAMERA, [A], DICTIONARY, CUBE)
    grey = [np.full((1200, 1920), 120, np.uint8)]
    assert set(look(grey, CAMERA, [A], DICTIONARY, CUBE).missing) == {A.name}


def test_the_camera_s_shift_adds_to_covariance_and_repeatability_alike() -> None:
    """A board at the height of the background: what the camera may have turned by is a shift of so many micrometres."""
    camera = lab_camera()
    T = transform(camera.T_base_camera[:3, :3], apply(camera.T_base_camera, np.array([0.0, 0.0, 1.0])))
    pose = BoardPose(lab_board(), T, 1e-12 * np.eye(6), 0.0, 1e3, repeatability=1e-13 * np.eye(6))
    still, turn = np.zeros(3), 1e-10 * np.diag([1.0, 1.0, 0.0])
    shift = CameraShift(still, turn, 0.0, 0.0, 50, 50, 4700.0, 1.0, 1000.0)
    now = with_camera_uncertainty(pose, camera, shift)
    assert now.repeatability is not None
    added = now.covariance - pose.covariance
    assert added == pytest.approx(now.repeatability - 1e-13 * np.eye(6), abs=1e-20)
    assert np.sqrt(np.diag(added)) == pytest.approx([1e-5, 1e-5, 0.0, 1e-5, 1e-5, 0.0], abs=1e-9)
    assert with_camera_uncertainty(replace(pose, repeatability=None), camera, shift).repeatability is None


@pytest.mark.slow
def test_a_hidden_marker_is_the_outline_s_matter_only_if_the_board_s_file_says_so() -> None:
    T = lying((0.46, 0.02, 0.034), 40.0, 7.0, 100.0)
    camera = view_of(corners_of(T))
    bar = Body("bar", Box((0.044, 0.02, 0.002)), T @ transform(t=(0.075, -0.075, 0.004)), "wire")
    image = picture(camera, [(as_designed(), T)], PLAIN, np.random.default_rng(3), [bar])
    limits = BoardLimits(height_m=4e-3)
    seen = look([image, image], camera, [PUZZLE, A], DICTIONARY, CUBE, limits, arm_in_view=True)
    assert seen.boards[0].pose.board is PUZZLE
    assert np.linalg.norm(twist_between(seen.poses[0].T_base_board, T)[:3]) < 8e-3
    without = replace(PUZZLE, outline=None)
    refused = look([image], camera, [without], DICTIONARY, CUBE, limits)
    assert refused.missing[PUZZLE.name].startswith("marker 2 is hidden, or less than 3 px inside")
    other = replace(PUZZLE, plate=Plate((0.12, 0.12, 0.003), PUZZLE.plate.centre), outline=_shrunk(PUZZLE))
    odd = look([image], camera, [other], DICTIONARY, CUBE, limits)
    assert odd.half_seen == (PUZZLE.name,)
    assert odd.missing[PUZZLE.name].startswith("marker 2 is hidden; board 01-02: ")


def _shrunk(board: Board) -> Outline:
    assert board.outline is not None
    corners = np.array(board.outline.corners)
    middle = corners.mean(axis=0)
    return replace(board.outline, corners=tuple(map(tuple, middle + 0.96 * (corners - middle))))
