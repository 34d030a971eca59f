"""Views that are held out tell the error of the calibration."""

import numpy as np
import pytest

from calib.camera.bundle_adjustment import information, intrinsics_covariance
from calib.camera.cross_validation import cross_validate
from calib.camera.working_volume import working_volume
from pictures.targets import ALL, NOISE_PX, camera, fitted


@pytest.mark.slow
def test_views_held_out_tell_the_error_at_the_work_points():
    work = working_volume(camera(), 0.9, 1.2)
    ratios, errors = [], []
    for seed in range(5):
        views, bundle = fitted(300 + seed)
        covariance = intrinsics_covariance(information(bundle, views), ALL, bundle.corner_sigma, bundle.prior)
        check = cross_validate(bundle, views, work)
        ratios.append(np.sqrt(np.mean(check.work_sigmas**2) / np.mean(work.sigmas(covariance) ** 2)))
        errors.append(check.sigma_px / NOISE_PX)
    assert 0.8 < np.median(ratios) < 1.8
    assert np.mean(errors) == pytest.approx(1.0, abs=0.05)
