"""Variance of a board's mean corners, and of its pose: as large as it says."""

from __future__ import annotations

import numpy as np
import pytest

from pictures.board_errors import CAMERA, Parts, bound, trials
from pictures.boards import lab_board, random_pose, seen_corners
from vision.boards.pose import assess_board


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("frames", "common_px", "bad", "size"),
    [
        (1, 0.0, 0.0, 0.036),
        (5, 0.3, 0.2, 0.036),
        *(
            pytest.param(*of, marks=pytest.mark.slow)
            for of in (
                (2, 0.3, 0.0, 0.040),
                (5, 0.0, 0.2, 0.036),
                (5, 0.15, 0.0, 0.040),
                (10, 0.3, 0.0, 0.036),
                (10, 0.0, 0.0, 0.040),
            )
        ),
    ],
)
def test_the_covariance_is_honest(frames: int, common_px: float, bad: float, size: float) -> None:
    """Holes, depth and turn each, and the whole twist, with and without noise that all frames share."""
    t = trials(60, frames, common_px, bad, size)
    for predicted, error in (
        (t.predicted.hole, t.over_bound.hole),
        (t.predicted.depth, t.over_bound.depth),
        (t.predicted.turn, t.over_bound.turn),
    ):
        assert 0.85 < predicted < 1.2  # times the bound, which the errors reach
        assert 0.75 < predicted / error < 1.35  # the luck of 60 scenes is a tenth; the bench has 4000
    assert 0.6 < t.nees.mean() < 1.5
    assert np.percentile(t.nees, 95) < 4.0  # 2.1 if the noise were known; it comes from ten residuals


def mean_spread(common_px: float, frames: int) -> float:
    """Predicted standard deviation of a hole, root of the mean over scenes, m."""
    squares = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, 7.0)
        seen = seen_corners(lab_board(), T, CAMERA, rng, frames, noise_px=0.3, common_px=common_px)
        pose = assess_board(lab_board(), seen, CAMERA).pose
        squares.append(Parts.of(pose.covariance, pose.board, T).hole)
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.slow
def test_more_frames_never_take_the_shared_part_away() -> None:
    """With 0.3 px shared, forty frames are as uncertain as that part alone; without it they gain by the root."""
    alone = [
        Parts.of(
            bound(lab_board(), random_pose(np.random.default_rng(s), 7.0), 0.3**2), lab_board(), np.eye(4)
        ).hole
        for s in range(30)
    ]
    assert mean_spread(0.3, 40) > 0.9 * np.sqrt(np.mean(alone))
    assert mean_spread(0.0, 40) < 0.5 * mean_spread(0.0, 5)
