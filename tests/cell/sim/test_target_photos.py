"""Poses of a target for photographs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cell.sim.target_photos import TargetCamera, corners_in_view, photograph_target, random_poses, target_pose
from pictures.rendered import changed, world_with
from pictures.seen_targets import BOARD, CAMERA
from vision.targets.target import TargetFinder


def test_poses_that_are_drawn_show_most_of_the_target():
    drawn = random_poses(CAMERA, BOARD, np.random.default_rng(14), 60)
    shares = [corners_in_view(CAMERA, BOARD, T).mean() for T in drawn]
    assert 0.6 <= min(shares) < 0.9


@pytest.mark.slow
def test_a_target_is_seen_by_the_true_camera_and_as_it_was_printed(tmp_path: Path):
    T = target_pose(CAMERA, BOARD, np.array([960.0, 600.0]), 1.1, np.array([0.2, 0.1]), 0.3)
    world = replace(world_with(tmp_path, ""), camera=None)

    def image(world):
        return TargetCamera(CAMERA, world, np.random.default_rng(2)).photograph(BOARD, T)

    plain = photograph_target(CAMERA, BOARD, T, np.random.default_rng(2))
    assert np.array_equal(image(None), plain)
    assert np.array_equal(image(world), plain)
    K = CAMERA.K.copy()
    K[:2, 2] += (3.0, -2.0)
    true = replace(world, camera=replace(CAMERA, K=K))
    larger = changed(true, "prints", print_scale=1.01)
    first, moved, grown = (
        TargetFinder(BOARD).find(i).corners_px for i in (plain, image(true), image(larger))
    )
    assert np.abs(moved - first - (3.0, -2.0)).max() < 0.2
    across = [np.linalg.norm(c[-1] - c[0]) for c in (moved, grown)]
    assert abs(across[1] / across[0] - 1.01) < 2e-3
