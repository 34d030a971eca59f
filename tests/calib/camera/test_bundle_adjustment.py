"""The adjustment of lens and poses: derivatives, an independent engine, and a covariance that is honest."""

import cv2
import numpy as np
import pytest

from calib.camera.bundle_adjustment import Prior, adjust, information, intrinsics_covariance
from calib.camera.initial_guess import initial_guess
from calib.camera.working_volume import working_volume
from calib.model.intrinsics import COUNT, vector_of
from pictures.targets import ALL, NOISE_PX, camera, fitted, poses, seen, views_of


def test_corners_without_noise_give_the_lens_back():
    views = views_of([seen(T, np.random.default_rng(2), noise_px=0.0) for T in poses(2)])
    begun = initial_guess(views, camera().size)
    bundle = adjust(views, begun.camera, begun.poses, ALL, begun.prior)
    assert vector_of(bundle.camera)[:4] == pytest.approx(vector_of(camera())[:4], abs=0.05)  # the prior
    assert bundle.corner_sigma < 1e-4


def test_lens_and_deviations_agree_with_opencv():
    views, bundle = fitted(3)
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    _, K, d, _, _, std, _, _ = cv2.calibrateCameraExtended(
        objectPoints=[v.points.astype(np.float32) for v in views],
        imagePoints=[v.pixels.astype(np.float32) for v in views],
        imageSize=camera().size,
        cameraMatrix=bundle.camera.K.copy(),
        distCoeffs=bundle.camera.distortion.copy(),
        flags=flags,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-12),
    )
    theirs = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *d.reshape(-1)[:5]])
    sigmas = np.sqrt(
        np.diag(intrinsics_covariance(information(bundle, views), ALL, bundle.corner_sigma, bundle.prior))
    )
    assert (np.abs(vector_of(bundle.camera) - theirs) < 0.02 * sigmas).all()
    assert sigmas == pytest.approx(std.reshape(-1)[:9], rel=0.02)


@pytest.mark.slow
def test_covariance_is_that_of_the_errors():
    scores, ratios = [], []
    for seed in range(24):
        views, bundle = fitted(100 + seed)
        covariance = intrinsics_covariance(information(bundle, views), ALL, bundle.corner_sigma, bundle.prior)
        off = vector_of(bundle.camera) - vector_of(camera())
        scores.append(off @ np.linalg.solve(covariance, off) / COUNT)
        ratios.append(bundle.corner_sigma / NOISE_PX)
    assert 0.75 < np.mean(scores) < 1.3  # 216 degrees of freedom: +- 0.1 a standard deviation
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.01)


def test_numbers_that_are_held_stay_and_have_no_variance():
    free = ALL.copy()
    free[[6, 8]] = False
    views, bundle = fitted(4, free=free)
    covariance = intrinsics_covariance(information(bundle, views), free, bundle.corner_sigma, bundle.prior)
    assert vector_of(bundle.camera)[[6, 8]] == pytest.approx(0.0, abs=0.0)
    assert not covariance[[6, 8]].any()
    assert (np.diag(covariance)[free] > 0.0).all()
    assert bundle.degrees_of_freedom == sum(v.pixels.size for v in views) - 6 * len(views) - 7


def test_the_prior_does_not_move_what_views_determine():
    views, bundle = fitted(7)
    wide = Prior(bundle.prior.mean, 100.0 * bundle.prior.sigma)
    again = adjust(views, bundle.camera, bundle.poses, ALL, wide)
    sigmas = np.sqrt(
        np.diag(intrinsics_covariance(information(bundle, views), ALL, bundle.corner_sigma, bundle.prior))
    )
    assert (np.abs(vector_of(again.camera) - vector_of(bundle.camera)) < 0.05 * sigmas).all()


def test_a_prior_that_is_sure_decides():
    views, bundle = fitted(8)
    mean, sigma = bundle.prior.mean.copy(), bundle.prior.sigma.copy()
    mean[2], sigma[2] = vector_of(camera())[2] + 5.0, 1e-4
    sure = adjust(views, bundle.camera, bundle.poses, ALL, Prior(mean, sigma))
    assert vector_of(sure.camera)[2] == pytest.approx(mean[2], abs=0.01)
    assert sure.cost < adjust(views, sure.camera, sure.poses, ALL, Prior(mean, sigma)).cost * (1 + 1e-6)


def test_the_camera_found_anew_absorbs_a_rigid_motion():
    work = working_volume(camera(), 0.9, 1.2)
    # a principal point that moves is a camera that turns, but for a share that grows with the field of view
    moved = np.zeros(COUNT)
    moved[2] = 1.0
    assert work.shifts(moved).max() < 0.05 * 1.2 / camera().K[0, 0]
    # a focal length of 1 % too much is a camera that stands farther away, but only at one distance
    longer = np.zeros(COUNT)
    longer[:2] = 0.01 * np.diag(camera().K)[:2]
    assert work.shifts(longer).max() > 1e-4
