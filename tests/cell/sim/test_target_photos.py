"""Poses of a target for photographs."""

import numpy as np

from cell.sim.target_photos import corners_in_view, random_poses
from pictures.seen_targets import BOARD, CAMERA


def test_poses_that_are_drawn_show_most_of_the_target():
    drawn = random_poses(CAMERA, BOARD, np.random.default_rng(14), 60)
    shares = [corners_in_view(CAMERA, BOARD, T).mean() for T in drawn]
    assert 0.6 <= min(shares) < 0.9
