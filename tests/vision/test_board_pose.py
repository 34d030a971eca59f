"""Board poses against the Cramer-Rao bound, with honest covariance, and every refusal."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.poses import hole_poses
from arm.se3 import Array, frozen, inverse, rotation, transform
from board_scenes import lab_board, lab_camera, random_pose, seen_corners, twist_between
from vision.board_fit import Corners, fit_weighted, pose_jacobian
from vision.board_pose import BoardLimits, estimate_board_pose
from vision.marker_size import fit_marker_size
from vision.markers import Marker

CAMERA = lab_camera()
BOARD = lab_board()
TILTS = (0.0, 7.0, 15.0)


def bound(T_base_board: Array, variance_px: float) -> Array:
    """Cramer-Rao bound of the twist for a variance of the mean corners, (6, 6)."""
    points = BOARD.marker_corners().reshape(8, 3)
    J = pose_jacobian(inverse(CAMERA.T_base_camera) @ T_base_board, points, CAMERA).reshape(-1, 6)
    return np.asarray(variance_px * np.linalg.inv(J.T @ J))


@dataclass(frozen=True)
class Trials:
    """Errors of hole centres (n, 4) m and rotations (n,) rad, what was predicted for both, and their bounds."""

    hole: float
    rotation: float
    hole_bound: float
    rotation_bound: float
    hole_predicted: float
    nees: float
    worst_rotation: float


def trials(count: int, bad_corner: float = 0.0, noise_px: float = 0.3, common_px: float = 0.0) -> Trials:
    """Root mean squares over seeded scenes; `bad_corner` is the part of frames with one corner 8 px off."""
    sums, worst = np.zeros(6), 0.0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, TILTS[seed % 3])
        frames = seen_corners(BOARD, T, CAMERA, rng, noise_px=noise_px, common_px=common_px)
        frames = [spoiled(f, rng) if rng.random() < bad_corner else f for f in frames]
        pose = estimate_board_pose(BOARD, frames, CAMERA)
        twist = twist_between(pose.T_base_board, T)
        C = bound(T, noise_px**2 / len(frames) + common_px**2)
        holes = hole_poses(pose)
        off = [h.T_base_hole[:3, 3] - (T @ BOARD.T_board_hole(h.index))[:3, 3] for h in holes]
        exact = hole_poses(replace(pose, covariance=C))
        sums += (
            np.mean(np.square(off)) * 3,
            twist[3:] @ twist[3:],
            np.mean([np.trace(h.covariance[:3, :3]) for h in exact]),
            np.trace(C[3:, 3:]),
            np.mean([np.trace(h.covariance[:3, :3]) for h in holes]),
            twist @ np.linalg.solve(pose.covariance, twist) / 6.0,
        )
        worst = max(worst, float(np.linalg.norm(twist[3:])))
    means = sums / count
    return Trials(*np.sqrt(means[:5]).tolist(), nees=float(means[5]), worst_rotation=worst)


def spoiled(frame: list[Marker], rng: np.random.Generator) -> list[Marker]:
    marker, corner = int(rng.integers(2)), int(rng.integers(4))
    corners = frame[marker].corners_px.copy()
    angle = rng.uniform(0, 2 * np.pi)
    corners[corner] += 8.0 * np.array([np.cos(angle), np.sin(angle)])
    return [replace(m, corners_px=frozen(corners)) if i == marker else m for i, m in enumerate(frame)]


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


def test_clean_corners_reach_the_bound() -> None:
    t = trials(300)
    assert t.hole / t.hole_bound < 1.10
    assert t.rotation / t.rotation_bound < 1.10
    assert 0.85 < t.hole_predicted / t.hole < 1.25
    assert 0.7 < t.nees < 1.3


def test_bad_corners_in_a_fifth_of_the_frames() -> None:
    t = trials(150, bad_corner=0.2)
    assert t.hole / t.hole_bound < 1.15
    assert t.worst_rotation < np.radians(2.0)


def test_common_noise_is_in_the_covariance() -> None:
    t = trials(150, common_px=0.3)
    assert t.hole / t.hole_bound < 1.15
    assert 0.8 < t.hole_predicted / t.hole < 1.25


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
        with pytest.raises(
            ImpossibleError, match=r"corners do not fit .*; markers 1 and 2 have changed places"
        ):
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
            words = rf"marker {which + 1} is turned by {90 * quarters} deg"
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
    with pytest.raises(ImpossibleError, match=r"marker 2 stands 149, 152 mm from marker 1, not 180, 140 mm"):
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
    assert not re.search("changed places|turned by|stands", str(refused.value))


def test_a_board_that_moves_between_frames_is_refused() -> None:
    rng = np.random.default_rng(7)
    T = random_pose(rng, 7.0)
    frames = seen_corners(BOARD, T, CAMERA, rng)
    moved = T.copy()
    moved[:3, 3] += (0.002, 0.0, 0.0)
    frames[3] = seen_corners(BOARD, moved, CAMERA, rng)[0]
    with pytest.raises(ImpossibleError, match=r"photograph 4 of 5 shows it .* it moved") as caught:
        estimate_board_pose(BOARD, frames, CAMERA)
    assert caught.value.data["photograph"] == 4


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
            assert "its tilt cannot be told" in str(error)  # noqa: PT017
            refused += 1
        else:
            assert np.linalg.norm(twist_between(pose.T_base_board, T)[3:]) < np.radians(8.0)
    assert refused >= 5
