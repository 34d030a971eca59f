"""What images tell without an arm: the noise of their corners, and which corners are wrong."""

import numpy as np
import pytest

from calib.chain.per_image_poses import fit_per_image_poses
from recorded.arm_sets import LENS, NOISE_PX, TARGETS, draw_truth, wide


def pictured(seed, kind="charuco", count=40, noise=(NOISE_PX, NOISE_PX)):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS[kind], count, rng)
    pixels = truth.pixels(joints, TARGETS[kind])
    return pixels + np.array(noise) * rng.standard_normal(pixels.shape), truth.T_camera_target(joints)


def test_poses_and_noise_are_found():
    pixels, T = pictured(1)
    found = fit_per_image_poses(LENS, TARGETS["charuco"], pixels)
    assert found.pixel_sigma == pytest.approx([NOISE_PX] * 2, rel=0.06)
    assert found.freedom == pytest.approx(40 * (48 - 6), abs=1.0)
    assert not found.wrong.any()
    off = np.linalg.norm(found.T_camera_target[:, :3, 3] - T[:, :3, 3], axis=1)
    assert np.median(off) < 3e-3


def test_noise_of_x_and_y_is_told_apart_where_there_are_corners_for_it():
    pixels, _ = pictured(2, noise=(0.5, 0.2))
    assert fit_per_image_poses(LENS, TARGETS["charuco"], pixels).pixel_sigma == pytest.approx(
        [0.5, 0.2], rel=0.08
    )
    pixels, _ = pictured(2, "marker", 150, noise=(0.5, 0.2))
    both = fit_per_image_poses(LENS, TARGETS["marker"], pixels).pixel_sigma
    assert both[0] == both[1] == pytest.approx(np.sqrt((0.5**2 + 0.2**2) / 2), rel=0.15)


def test_a_tenth_of_images_that_are_spoilt_does_not_widen_the_noise():
    pixels, _ = pictured(3)
    rng = np.random.default_rng(4)
    pixels[:4] += 8.0 * rng.standard_normal(pixels[:4].shape)
    found = fit_per_image_poses(LENS, TARGETS["charuco"], pixels)
    assert found.pixel_sigma == pytest.approx([NOISE_PX] * 2, rel=0.08)


def test_wrong_corners_are_named_and_no_others():
    pixels, _ = pictured(5)
    planted = np.zeros(pixels.shape[:2], dtype=bool)
    planted[3, 7] = planted[11, 20] = planted[12, [2, 15]] = True
    pixels[planted] += (9.0, -7.0)
    assert fit_per_image_poses(LENS, TARGETS["charuco"], pixels).wrong.tolist() == planted.tolist()


def test_corners_that_were_not_seen_are_left_out():
    pixels, _ = pictured(6)
    pixels[::2, :9] = np.nan
    found = fit_per_image_poses(LENS, TARGETS["charuco"], pixels)
    assert np.isnan(found.residuals[::2, :9]).all()
    assert np.isfinite(found.residuals[1::2]).all()
    assert found.freedom == pytest.approx(20 * 42 + 20 * 24, abs=1.0)
    assert found.pixel_sigma == pytest.approx([NOISE_PX] * 2, rel=0.08)


def test_images_without_noise_are_weighed_too():
    pixels, T = pictured(7, noise=(0.0, 0.0))
    found = fit_per_image_poses(LENS, TARGETS["charuco"], pixels)
    assert (found.pixel_sigma > 0.9e-6).all()
    assert found.pixel_sigma.max() < 1e-3
    assert np.isfinite(found.noise).all()
    assert np.abs(found.T_camera_target - T).max() < 1e-4
