"""Intrinsics as a vector, and its Jacobian by finite differences."""

import numpy as np
import pytest

from calib.model.intrinsics import COUNT, camera_of, lens_parameter_jacobian, vector_of
from pictures.targets import camera


def test_lens_parameter_jacobian_is_the_derivative_of_the_projection():
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.2, 0.2, (50, 2)), rng.uniform(0.8, 1.3, 50)])
    vector = vector_of(camera())
    J = lens_parameter_jacobian(camera(), points)
    for i in range(COUNT):
        step = np.zeros(COUNT)
        step[i] = 1e-6 * max(1.0, abs(vector[i]))
        ahead, behind = (camera_of(vector + s * step, camera().size).project(points) for s in (1, -1))
        assert J[..., i] == pytest.approx((ahead - behind) / (2 * step[i]), rel=1e-6, abs=1e-6)
