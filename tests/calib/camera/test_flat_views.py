"""Flat views: a lifted view tells the focal length, flat ones alone have an interval that holds the true one."""

import numpy as np
import pytest

from arm.errors import CalibrationRefused
from calib.camera.calibrate import calibrate_camera
from calib.camera.flat_views import FlatViews, Lift
from calib.model.intrinsics import vector_of
from pictures.targets import CHARUCO, photos, taken
from recorded.flat_targets import F_PX, FLAT, SIZE, flat_views, photos_of


def problem(seed, count, lifts=()):
    return FlatViews(flat_views(seed, count, lifts), FLAT, SIZE, [Lift(x) if x else None for x in lifts])


def test_derivatives_are_those_of_the_residuals():
    lifts = (0.05, 0.0)
    p = problem(1, 2, lifts)
    s = p._moved(p._start(np.log(F_PX)), 1e-3 * np.random.default_rng(0).standard_normal(12 + 5 + 32 + 18))
    _, J = p._rows(s, 0.01, derive=True)
    for k in range(J.shape[1]):
        step = np.zeros(J.shape[1])
        step[k] = 1e-2 if k in (2, 3) else 1e-5
        change = p._rows(p._moved(s, step), 0.01)[0] - p._rows(p._moved(s, -step), 0.01)[0]
        assert -change / (2.0 * step[k]) == pytest.approx(J[:, k], abs=2e-3 * np.abs(J[:, k]).max()), k


def test_a_lifted_view_tells_the_focal_length():
    p = problem(2, 5, (0.05, 0.0, 0.0, 0.0, 0.0))
    there, wrong = (p._at(np.log(f), np.radians(0.1))[1] for f in (F_PX, 1.1 * F_PX))
    assert there > wrong + 4.0


def test_a_view_tilted_against_the_others_is_no_lifted_one():
    with pytest.raises(CalibrationRefused, match="with --lift it must lie on the plane"):
        calibrate_camera(photos(taken(1)), CHARUCO, SIZE, lifts={"03.png": Lift(0.05)})


@pytest.mark.slow
def test_a_flat_set_is_refused_and_its_interval_holds_the_focal_length():
    c = calibrate_camera(photos_of(flat_views(3, 15)), FLAT, SIZE)
    assert not c.accepted
    assert "give --lift IMAGE=HEIGHT_MM" in c.reasons[0]
    assert abs(vector_of(c.camera)[0] - F_PX) < 2.5 * c.sigmas[0]
    assert c.sigmas[0] > 0.03 * F_PX
    low, high = c.focal_interval
    assert low < F_PX < high
    assert f"{low:.0f} to {high:.0f} px" in c.reasons[0]


@pytest.mark.slow
def test_a_flat_set_with_a_view_on_a_box_is_accepted():
    views = flat_views(4, 12, (0.05, *[0.0] * 11))
    c = calibrate_camera(photos_of(views), FLAT, SIZE, lifts={"00.png": Lift(0.05)})
    assert not any("tilted" in reason for reason in c.reasons)
    assert c.sigmas[0] < 0.02 * F_PX
    assert abs(vector_of(c.camera)[0] - F_PX) < 3.0 * c.sigmas[0]
