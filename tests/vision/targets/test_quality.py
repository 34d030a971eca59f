"""Blur, contrast and exposure of a target's image."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cell.sim.target_photos import Shot, photograph_target, target_pose
from pictures.seen_targets import BOARD, CAMERA, photograph
from vision.targets.quality import measure_quality
from vision.targets.target import TargetFinder


@pytest.mark.parametrize("psf_px", [0.7, 2.0, 3.0])
def test_blur_is_measured(psf_px):
    image, _ = photograph(BOARD, 5, Shot(psf_px=psf_px))
    view = TargetFinder(BOARD).find(image)
    assert view is not None
    # the pixel's own width adds to the lens's
    assert measure_quality(image, BOARD, view).blur_px == pytest.approx(np.hypot(psf_px, 0.5), rel=0.12)


def test_motion_blurs_the_edges_across_it_only_and_counts():
    image, _ = photograph(BOARD, 6, roll=0.0)
    moved = np.asarray(cv2.filter2D(image, -1, np.full((1, 9), 1 / 9)), dtype=np.uint8)
    finder = TargetFinder(BOARD)
    sharp, blurred = (measure_quality(i, BOARD, finder.find(i)).blur_px for i in (image, moved))
    assert sharp < 1.2
    assert blurred > 2.2


def test_markers_are_measured_in_squares():
    for true in (0.021, 0.022, 0.0235):
        image, _ = photograph(BOARD, 8, Shot(true_marker=true))
        view = TargetFinder(BOARD).find(image)
        assert measure_quality(image, BOARD, view).marker_share == pytest.approx(true / 0.030, rel=0.004)


def test_markers_are_measured_through_a_wide_lens_that_distorts():
    f = 0.6 * 1920
    wide = replace(
        CAMERA,
        K=np.array([[f, 0.0, 959.5], [0.0, f, 599.5], [0.0, 0.0, 1.0]]),
        distortion=np.array([-0.3, 0.1, 0.0, 0.0, 0.0]),
    )
    T = target_pose(wide, BOARD, np.array([700.0, 500.0]), 0.2, np.array([0.3, -0.2]), 0.1)
    image = photograph_target(wide, BOARD, T, np.random.default_rng(10))
    view = TargetFinder(BOARD).find(image)
    assert view is not None
    assert measure_quality(image, BOARD, view).marker_share == pytest.approx(22 / 30, rel=0.005)


def test_overexposed_white_is_told():
    image, _ = photograph(BOARD, 9)
    bright = np.clip(image.astype(float) * 1.4, 0, 255).astype(np.uint8)
    finder = TargetFinder(BOARD)
    assert measure_quality(image, BOARD, finder.find(image)).saturated == 0.0
    assert measure_quality(bright, BOARD, finder.find(bright)).saturated > 0.9
