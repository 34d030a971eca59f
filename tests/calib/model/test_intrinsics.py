"""Intrinsics as a vector."""

import numpy as np
import pytest

from calib.model.intrinsics import NAMES, camera_of, pinhole, vector_of
from pictures.targets import camera


def test_a_vector_makes_the_camera_that_it_was_made_of():
    again = camera_of(vector_of(camera()), camera().size)
    assert (again.K == camera().K).all()
    assert (again.distortion == camera().distortion).all()
    assert dict(zip(NAMES, vector_of(again), strict=True))["fy"] == camera().K[1, 1]


def test_a_pinhole_looks_at_the_middle_of_its_image():
    found = pinhole(1500.0, (1920, 1200))
    assert found.project((0.0, 0.0, 2.0)) == pytest.approx((959.5, 599.5))  # pixels begin at 0
    assert found.project((0.1, 0.0, 1.0)) - (959.5, 599.5) == pytest.approx((150.0, 0.0))
    assert not np.any(found.distortion)
