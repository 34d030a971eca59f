"""What a wrong lens does at the work points, against moving the camera by hand."""

import numpy as np
import pytest

from arm.se3 import rotation
from calib.intrinsics import camera_of, vector_of
from calib.work_points import work_points
from target_scenes import camera

CHANGE = np.array([3.0, -2.0, 4.0, 1.0, 0.005, 0.2, 1e-4, -2e-4, 1.0])


def test_shifts_are_what_is_left_after_the_camera_was_placed_anew():
    work = work_points(camera(), 0.9, 1.3)
    lens = camera_of(vector_of(camera()) + CHANGE, camera().size)
    metres = work.points[:, 2:] / np.diag(camera().K)[:2]

    def seen(place):
        return lens.project(work.points @ rotation(place[3:]).T + place[:3])

    place = np.zeros(6)
    for _ in range(5):
        slopes = [(seen(place + h) - seen(place - h)) / 2e-6 for h in 1e-6 * np.eye(6)]
        J = np.stack([(metres * slope).ravel() for slope in slopes], axis=-1)
        off = metres * (seen(place) - camera().project(work.points))
        place = place - np.linalg.lstsq(J, off.ravel(), rcond=None)[0]
    left = np.linalg.norm(metres * (seen(place) - camera().project(work.points)), axis=1)
    assert left.max() > 2e-5
    assert work.shifts(CHANGE) == pytest.approx(left, abs=0.02 * left.max())


def test_one_standard_deviation_of_a_change_is_that_change():
    work = work_points(camera(), 0.9, 1.3)
    covariance = np.outer(CHANGE, CHANGE)
    assert work.sigmas(covariance) == pytest.approx(work.shifts(CHANGE), rel=1e-6)
    assert np.trace(work.worth @ covariance) == pytest.approx(np.mean(work.shifts(CHANGE) ** 2))
