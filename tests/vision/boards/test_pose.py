"""Board poses against the Cramer-Rao bound, with honest covariance, and every refusal."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from arm.board import PLATE_CENTRE
from arm.errors import ImpossibleError
from arm.se3 import Array, frozen, inverse, rot_z, rotation, transform
from pictures.boards import lab_board, lab_camera, random_pose, seen_corners, spoiled, twist_between
from vision.boards.marker_size import fit_marker_size
from vision.boards.pose import BoardLimits, assess_board, estimate_board_pose
from vision.boards.pose_fit import Corners, fit_weighted, pose_jacobian
from vision.markers.detect import Marker

CAMERA = lab_camera()
BOARD = lab_board()
TILTS = (0.0, 7.0, 15.0)


def test_noise_free_corners_give_the_pose_exactly() -> None:
    for seed, tilt in enumerate((0.0, 7.0, 15.0, 40.0)):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, tilt)
        pose = estimate_board_pose(BOARD, seen_corners(BOARD, T, CAMERA, rng, noise_px=0.0), CAMERA)
        assert np.abs(pose.T_base_board - T).max() < 1e-8
        assert pose.residual_px < 1e-6
        assert pose.tilt() == pytest.approx(np.radians(tilt), abs=1e-6)


def test_pose_jacobian_by_differences() -> None:
    T = inverse(CAMERA.T_base_camera) @ random_pose(np.random.default_rng(0), 15.0)
    points = BOARD.marker_corners().reshape(8, 3)
    J, h = pose_jacobian(T, points, CAMERA), 1e-6

    def pixels(xi: Array) -> Array:
        moved = T @ transform(rotation(xi[3:]), xi[:3])
        return CAMERA.project(points @ moved[:3, :3].T + moved[:3, 3])

    for k in range(6):
        step = h * np.eye(6)[k]
        difference = (pixels(step) - pixels(-step)) / (2 * h)
        assert np.abs(J[..., k] - difference).max() < 1e-5 * np.abs(difference).max()


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


@pytest.mark.parametrize("hidden", [0, 1])
def test_a_missing_marker_is_named(hidden: int) -> None:
    rng = np.random.default_rng(5)
    frames = seen_corners(BOARD, random_pose(rng, 7.0), CAMERA, rng)
    with pytest.raises(ImpossibleError, match=f"board 01-02: marker {hidden + 1} is in none of 5") as caught:
        estimate_board_pose(BOARD, [[f[1 - hidden]] for f in frames], CAMERA)
    assert caught.value.data["missing"] == [hidden + 1]


@pytest.mark.parametrize("off_mm", [-1.0, 1.0])
def test_a_wrong_marker_size_is_refused_and_the_right_one_named(off_mm: float) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        frames = seen_corners(BOARD, random_pose(rng, TILTS[seed % 3]), CAMERA, rng)
        stated = lab_board(marker_size=BOARD.marker_size + 1e-3 * off_mm)
        with pytest.raises(
            ImpossibleError, match=r"marker size = .*36\.\d\d mm does|35\.9\d mm does"
        ) as caught:
            estimate_board_pose(stated, frames, CAMERA)
        assert caught.value.data["fitting_size"] == pytest.approx(0.036, abs=1e-4)


def test_marker_size_and_its_deviation() -> None:
    normalised = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, TILTS[seed % 3])
        frames = seen_corners(BOARD, T, CAMERA, rng, frames=3)
        pixels = np.array([[m.corners_px for m in f] for f in frames]).reshape(3, 8, 2)
        corners = Corners(pixels, BOARD.marker_corners().reshape(8, 3))
        fit = fit_weighted(corners, np.ones((3, 8)), inverse(CAMERA.T_base_camera) @ T, CAMERA)
        size = fit_marker_size(BOARD, fit, CAMERA, 0.02)
        normalised.append((size.size - 0.036) / size.sigma)
    assert 0.7 < np.std(normalised) < 1.4


def test_swapped_and_turned_markers_are_refused_and_named() -> None:
    for seed, tilt in enumerate(TILTS):
        rng = np.random.default_rng(seed)
        frames = seen_corners(BOARD, random_pose(rng, tilt), CAMERA, rng)
        swapped = [[replace(f[0], id=2), replace(f[1], id=1)] for f in frames]
        with pytest.raises(ImpossibleError, match=r"corners do not fit .*; markers 1 and 2 are swapped"):
            estimate_board_pose(BOARD, swapped, CAMERA)
        for which, quarters in ((0, 1), (1, 2), (1, 3)):
            turned = [
                [
                    replace(m, corners_px=frozen(np.roll(m.corners_px, quarters, axis=0)))
                    if i == which
                    else m
                    for i, m in enumerate(f)
                ]
                for f in frames
            ]
            words = rf"marker {which + 1} is rotated by {90 * quarters} deg"
            with pytest.raises(ImpossibleError, match=words):
                estimate_board_pose(BOARD, turned, CAMERA)


def test_a_marker_of_another_board_is_told_by_where_it_stands() -> None:
    rng = np.random.default_rng(8)
    T = random_pose(rng, 7.0)
    corners = np.array(BOARD.marker_corners())
    corners[1] += (-0.031, 0.012, 0.0)
    px = CAMERA.project_base(corners @ T[:3, :3].T + T[:3, 3])
    frames = [
        [
            Marker(i, frozen(c + 0.1 * rng.standard_normal((4, 2))), "lines")
            for i, c in zip(BOARD.marker_ids, px, strict=True)
        ]
        for _ in range(5)
    ]
    with pytest.raises(ImpossibleError, match=r"marker 2 is at 149, 152 mm from marker 1, not 180, 140 mm"):
        estimate_board_pose(BOARD, frames, CAMERA)


def test_corners_that_no_arrangement_explains_are_refused_without_one() -> None:
    """A second marker a tenth too large stands nowhere on the plate as one of the board's size."""
    rng = np.random.default_rng(9)
    T = random_pose(rng, 7.0)
    corners = np.array(BOARD.marker_corners())
    corners[1] = corners[1].mean(axis=0) + 1.1 * (corners[1] - corners[1].mean(axis=0))
    px = CAMERA.project_base(corners @ T[:3, :3].T + T[:3, 3])
    frames = [[Marker(i, frozen(c), "lines") for i, c in zip(BOARD.marker_ids, px, strict=True)]] * 5
    with pytest.raises(ImpossibleError, match=r"corners do not fit") as refused:
        estimate_board_pose(BOARD, frames, CAMERA)
    assert not re.search("swapped|rotated by|is at", str(refused.value))


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
    with pytest.raises(ImpossibleError, match=rf"photograph \d of {frames} shows it .* it moved") as caught:
        estimate_board_pose(BOARD, mixed, CAMERA)
    if late == 3:
        assert caught.value.data["photograph"] == 4


def test_one_bad_corner_is_no_movement() -> None:
    rng = np.random.default_rng(7)
    for _ in range(20):
        frames = seen_corners(BOARD, random_pose(rng, 7.0), CAMERA, rng, noise_px=0.1)
        assert assess_board(BOARD, [spoiled(frames[0], rng), *frames[1:]], CAMERA).accepted


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
