"""Whether another marker size fits better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.se3 import inverse
from pictures.board_errors import BOARD, CAMERA, TILTS
from pictures.boards import lab_board, random_pose, seen_corners, twist_between
from vision.boards.marker_size import fit_marker_size
from vision.boards.pose import estimate_board_pose
from vision.boards.pose_fit import Corners, fit_weighted


@pytest.mark.parametrize("off_mm", [-0.4, -0.2, -0.1, 0.1, 0.2, 0.4])
def test_a_size_is_named_from_a_third_of_a_millimetre_on_and_covered_below(off_mm: float) -> None:
    """A print that is 0.5 % large is no wrong size; the board's tolerance has it in the covariance."""
    rng = np.random.default_rng(5)
    T = random_pose(rng, 7.0)
    true = lab_board(marker_size=0.036 + 1e-3 * off_mm)
    frames = seen_corners(true, T, CAMERA, rng, noise_px=0.01)
    board = replace(lab_board(), tolerance=1e-4)
    if abs(off_mm) > 0.3:
        with pytest.raises(ImpossibleError, match="marker size = 36 mm does not fit") as e:
            estimate_board_pose(board, frames, CAMERA)
        assert e.value.data["fitting_size"] == pytest.approx(true.marker_size, abs=2e-5)
    else:
        pose = estimate_board_pose(board, frames, CAMERA)
        xi = twist_between(pose.T_base_board, T)
        assert xi @ np.linalg.solve(pose.covariance, xi) / 6.0 < 3.0
        assert np.linalg.norm(xi[:3]) < 0.5e-3


@pytest.mark.few(1)
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
