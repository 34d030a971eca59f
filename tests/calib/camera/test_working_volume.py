"""What a wrong lens does at the work points, against moving the camera by hand."""

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from arm.se3 import rotation
from calib.camera.working_volume import working_volume
from calib.model.intrinsics import camera_of, vector_of
from pictures.targets import camera

CHANGE = np.array([3.0, -2.0, 4.0, 1.0, 0.005, 0.2, 1e-4, -2e-4, 1.0])


def test_shifts_are_what_is_left_after_the_camera_was_placed_anew():
    work = working_volume(camera(), 0.9, 1.3)
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
    work = working_volume(camera(), 0.9, 1.3)
    covariance = np.outer(CHANGE, CHANGE)
    assert work.sigmas(covariance) == pytest.approx(work.shifts(CHANGE), rel=1e-6)
    assert np.trace(work.worth.T @ covariance @ work.worth) == pytest.approx(
        np.mean(work.shifts(CHANGE) ** 2)
    )


def test_a_region_has_points_in_it_only_and_a_smaller_effect():
    whole, part = (
        working_volume(camera(), 0.9, 1.3),
        working_volume(camera(), 0.9, 1.3, (480.0, 300.0, 960.0, 900.0)),
    )
    pixels = camera().project(part.points)
    assert pixels.min(axis=0) == pytest.approx([480.0 - 0.5 + 480.0 / 18, 300.0 - 0.5 + 600.0 / 12])
    assert pixels.max(axis=0) == pytest.approx([960.0 - 0.5 - 480.0 / 18, 900.0 - 0.5 - 600.0 / 12])
    assert part.shifts(CHANGE).max() < 0.5 * whole.shifts(CHANGE).max()
    turning = camera_of(np.array([*vector_of(camera())[:4], 0.0, -60.0, 0.0, 0.0, 0.0]), camera().size)
    middle = working_volume(turning, 0.9, 1.3, (900.0, 550.0, 1000.0, 650.0))
    assert middle.seen.all()
    assert (
        middle.blind == working_volume(turning, 0.9, 1.3).blind > 0.0
    )  # a camera file needs the inverse everywhere


def test_places_where_the_lens_has_no_inverse_have_no_points():
    """Radial terms that turn back at a radius: what is left has the same effect as before; nothing left is refused."""
    lens = camera_of(np.array([*vector_of(camera())[:4], 0.0, -60.0, 0.0, 0.0, 0.0]), camera().size)
    work = working_volume(lens, 0.9, 1.3)
    assert 0.0 < work.blind < 0.9
    assert len(work.points) == 3 * work.seen.sum()
    assert np.isfinite(work.effect).all()
    assert work.seen[2:4, 3:6].all()
    assert working_volume(camera(), 0.9, 1.3).blind == 0.0
    nowhere = camera_of(np.array([*vector_of(camera())[:4], 0.0, -1e9, 0.0, 0.0, 0.0]), camera().size)
    with pytest.raises(CalibrationRefused, match=r"no inverse at \d+ of 54 places"):
        working_volume(nowhere, 0.9, 1.3)
