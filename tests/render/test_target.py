"""A calibration target as it is drawn."""

import numpy as np

from cell.sim.target_photos import Shot, photograph_target, target_pose
from pictures.seen_targets import BOARD, CAMERA, MIDDLE
from vision.targets.target import TargetFinder


def test_a_bent_target_is_drawn_bent():
    rng = np.random.default_rng(1)
    T = target_pose(CAMERA, BOARD, MIDDLE, 1.0, np.array([0.0, 0.6]), 0.0)
    flat, bent = (
        TargetFinder(BOARD).find(photograph_target(CAMERA, BOARD, T, rng, Shot(bend=b))) for b in (0.0, 1e-3)
    )
    common, here, there = np.intersect1d(flat.ids, bent.ids, return_indices=True)
    moved = bent.corners_px[there] - flat.corners_px[here]
    points = BOARD.points()[common]
    half = BOARD.size[0] / 2.0
    rise = 1e-3 * (1.0 - (points[:, 0] / half - 1.0) ** 2)
    raised = (points - rise[:, None] * (0.0, 0.0, 1.0)) @ T[:3, :3].T + T[:3, 3]
    expected = CAMERA.project(raised) - CAMERA.project(points @ T[:3, :3].T + T[:3, 3])
    assert np.abs(moved - expected).max() < 0.2
    assert np.abs(expected).max() > 1.0
