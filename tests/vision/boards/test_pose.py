"""Board poses against the Cramer-Rao bound, with honest covariance, and every refusal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.board import PLATE_CENTRE
from arm.errors import ImpossibleError
from arm.se3 import frozen, inverse, rot_z, transform
from pictures.board_errors import BOARD, CAMERA
from pictures.boards import random_pose, seen_corners, spoiled, twist_between
from vision.boards.pose import BoardLimits, assess_board, estimate_board_pose
from vision.markers.detect import Marker


def test_noise_free_corners_give_the_pose_exactly() -> None:
    for seed, tilt in enumerate((0.0, 7.0, 15.0, 40.0)):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, tilt)
        pose = estimate_board_pose(BOARD, seen_corners(BOARD, T, CAMERA, rng, noise_px=0.0), CAMERA)
        assert np.abs(pose.T_base_board - T).max() < 1e-8
        assert pose.residual_px < 1e-6
        assert pose.tilt() == pytest.approx(np.radians(tilt), abs=1e-6)


def test_more_frames_do_not_shrink_the_covariance_without_end() -> None:
    rng = np.random.default_rng(2)
    T = random_pose(rng, 7.0)
    few, many = (
        estimate_board_pose(BOARD, seen_corners(BOARD, T, CAMERA, rng, n, noise_px=0.01), CAMERA)
        for n in (5, 200)
    )
    ratio = np.sqrt(np.trace(few.covariance[:3, :3]) / np.trace(many.covariance[:3, :3]))
    assert 0.95 < ratio < 1.3
    subpix = [
        [replace(m, method="subpix") for m in f]
        for f in seen_corners(BOARD, T, CAMERA, rng, 5, noise_px=0.01)
    ]
    wide = estimate_board_pose(BOARD, subpix, CAMERA)
    assert np.trace(wide.covariance) > 20 * np.trace(few.covariance)


@pytest.mark.parametrize(("height", "least", "most"), [(1.0, 35.0, 80.0), (4.5, 200.0, 450.0)])
def test_small_markers_measured_by_their_corners_are_less_certain(
    height: float, least: float, most: float
) -> None:
    """Variance against that with border lines, of markers of 170 and 38 px: (0.15 / 0.02)^2 and (0.35 / 0.02)^2."""
    rng = np.random.default_rng(8)
    camera = CAMERA.at(transform(CAMERA.T_base_camera[:3, :3], (0.46, 0.0, height)))
    lines = seen_corners(BOARD, random_pose(rng, 7.0), camera, rng, 30, noise_px=0.01)
    corners = [[replace(m, method="subpix") for m in frame] for frame in lines]
    by_lines, by_corners = (assess_board(BOARD, frames, camera).pose for frames in (lines, corners))
    assert by_lines is not None
    assert by_corners is not None
    assert least < np.trace(by_corners.covariance) / np.trace(by_lines.covariance) < most


def test_a_marker_hidden_in_some_frames_is_used_in_the_others() -> None:
    rng = np.random.default_rng(3)
    T = random_pose(rng, 15.0)
    frames = seen_corners(BOARD, T, CAMERA, rng, noise_px=0.05)
    partly = [frames[0], frames[1][:1], frames[2][1:], [], frames[4]]
    pose = estimate_board_pose(BOARD, partly, CAMERA)
    assert np.abs(pose.T_base_board - T)[:3, 3].max() < 1e-3


def test_markers_of_other_boards_are_left_alone() -> None:
    rng = np.random.default_rng(4)
    T = random_pose(rng, 7.0)
    frames = seen_corners(BOARD, T, CAMERA, rng, noise_px=0.1)
    other = Marker(9, frozen(np.zeros((4, 2))), "subpix")
    with_other = [[*f, other] for f in frames]
    a, b = (estimate_board_pose(BOARD, f, CAMERA) for f in (frames, with_other))
    assert np.array_equal(a.T_base_board, b.T_base_board)
    assert np.array_equal(a.covariance, b.covariance)


def test_markers_that_fit_in_no_pose_in_front_of_the_camera_are_told_in_one_line() -> None:
    """Of a lens with k1 alone, which folds far outside the image, and markers that touch at a corner."""
    K = np.array([[4740.0, 0.0, 959.5], [0.0, 4740.0, 599.5], [0.0, 0.0, 1.0]])
    camera = replace(CAMERA, K=K, distortion=np.array([-0.25, 0.0, 0.0, 0.0, 0.0]), size=(1920, 1200))
    first = np.array([[700, 400], [860, 400], [860, 560], [700, 560]], dtype=float)
    markers = [Marker(1, frozen(first), "lines"), Marker(2, frozen(first + 160.0), "lines")]
    seen = assess_board(BOARD, [markers], camera)
    assert seen.pose is None
    (doubt,) = seen.doubts
    assert doubt.data["markers_px"] == [[780.0, 480.0], [940.0, 640.0]]
    assert "marker 1 at 780, 480 px and marker 2 at 940, 640 px fit it in no pose in front" in str(doubt)
    assert "marker 2 is at 36, -36 mm from marker 1, not 180, 140 mm" in str(doubt)
    assert "check K_px and distortion" in str(doubt)
    assert "nan" not in str(doubt)


def test_a_board_that_does_not_fit_is_told_in_one_line() -> None:
    """Its tilt and its uncertainty are not worth a word."""
    rng = np.random.default_rng(6)
    frames = seen_corners(replace(BOARD, second_marker=(0.12, 0.10)), random_pose(rng, 7.0), CAMERA, rng)
    (doubt,) = assess_board(BOARD, frames, CAMERA).doubts
    assert "marker 2 is at 120, 100 mm from marker 1" in str(doubt)


@pytest.mark.parametrize("hidden", [0, 1])
def test_a_missing_marker_is_named(hidden: int) -> None:
    rng = np.random.default_rng(5)
    frames = seen_corners(BOARD, random_pose(rng, 7.0), CAMERA, rng)
    with pytest.raises(ImpossibleError, match=f"board 01-02: marker {hidden + 1} is in none of 5") as caught:
        estimate_board_pose(BOARD, [[f[1 - hidden]] for f in frames], CAMERA)
    assert caught.value.data["missing"] == [hidden + 1]


@pytest.mark.parametrize(
    ("frames", "late"), [(5, 3), (5, 1), (2, 1), (3, 2)], ids=["one of 5", "from 2 of 5 on", "2", "3"]
)
@pytest.mark.parametrize("turned", [False, True])
def test_a_board_that_moves_between_frames_is_refused(frames: int, late: int, turned: bool) -> None:
    """By 2 mm, or by 1.5 deg about its middle, which takes its markers to opposite sides."""
    rng = np.random.default_rng(7)
    T = random_pose(rng, 7.0)
    centre = transform(t=(*PLATE_CENTRE, 0.0))
    step = transform(t=(0.002, 0.0, 0.0))
    if turned:
        step = centre @ transform(rot_z(np.radians(1.5))) @ inverse(centre)
    seen = seen_corners(BOARD, T, CAMERA, rng, frames)
    elsewhere = seen_corners(BOARD, T @ step, CAMERA, rng, frames)
    mixed = [*seen[:late], elsewhere[late], *(seen if late == 3 else elsewhere)[late + 1 :]]
    with pytest.raises(ImpossibleError, match=rf"image \d of {frames} shows it .* it moved") as caught:
        estimate_board_pose(BOARD, mixed, CAMERA)
    if late == 3:
        assert caught.value.data["photograph"] == 4


def test_one_bad_corner_is_no_movement() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        frames = seen_corners(BOARD, random_pose(rng, 7.0), CAMERA, rng, noise_px=0.1)
        assert assess_board(BOARD, [spoiled(frames[0], rng), *frames[1:]], CAMERA).accepted


def test_a_mirrored_solution_that_ends_up_in_the_first_is_no_second_one() -> None:
    """With markers that may be displaced, the refined mirrored solution can run into the true one."""
    board, rng = replace(BOARD, tolerance=2e-4), np.random.default_rng(253)
    frames = seen_corners(board, random_pose(rng, 15.0), CAMERA, rng, noise_px=0.2)
    seen = assess_board(board, frames, CAMERA, tilts=tuple(np.radians([0.0, 7.0, 15.0])))
    assert seen.accepted, seen.doubts[0]


def test_a_tilt_that_cannot_be_told_is_refused() -> None:
    """From 8 m both planar solutions fit noisy corners alike; from 1 m never."""
    far = CAMERA.at(transform(CAMERA.T_base_camera[:3, :3], (0.46, 0.0, 8.0)))
    limits, refused = BoardLimits(), 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, 15.0)
        frames = seen_corners(BOARD, T, far, rng, frames=1, noise_px=0.2)
        try:
            pose = estimate_board_pose(BOARD, frames, far, limits)
        except ImpossibleError as error:
            assert "its tilt cannot be distinguished" in str(error)  # noqa: PT017
            refused += 1
        else:
            assert np.linalg.norm(twist_between(pose.T_base_board, T)[3:]) < np.radians(8.0)
    assert refused >= 5
