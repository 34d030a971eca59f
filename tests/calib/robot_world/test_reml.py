"""The restricted likelihood and its gradient, by finite differences."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from arm.se3 import rotation, transform
from calib.robot_world.noise_model import Covariances, NoiseModel
from calib.robot_world.reml import Closed, _Likelihood, moved
from recorded.posed_pairs import HELD, STANDING, drawn, views

SHAPES = (NoiseModel(), NoiseModel("image"), NoiseModel("image", off_centre=True), NoiseModel(geometry=True))


@pytest.mark.parametrize("in_gripper", [False, True])
def test_derivatives_of_the_predicted_pose_are_those_of_finite_differences(in_gripper):
    rng = np.random.default_rng(1)
    said, seen = views(rng, 6, in_gripper)
    P, Q = (HELD, STANDING) if in_gripper else (STANDING, HELD)
    at = Closed(said, seen, in_gripper).linearised(P, Q)
    assert np.abs(at.residuals).max() < 1e-9
    for k, step in enumerate(1e-6 * np.eye(12)):
        then = Closed(said, seen, in_gripper).linearised(moved(P, step[:6]), moved(Q, step[6:]))
        assert -then.residuals / 1e-6 == pytest.approx(at.by_unknowns[:, :, k], abs=1e-5)
    for k, step in enumerate(1e-6 * np.eye(6)):
        arm = said @ transform(rotation(step[3:]), step[:3])
        then = Closed(arm, seen, in_gripper).linearised(P, Q)
        assert -then.residuals / 1e-6 == pytest.approx(at.by_arm[:, :, k], abs=1e-5)


@pytest.mark.parametrize("scatter", SHAPES)
def test_the_gradient_of_the_likelihood_is_that_of_finite_differences(scatter):
    pairs = drawn(2, 9)
    rows = np.ones((9, 6), dtype=bool)
    rows[2, 3:] = rows[4] = False
    at = Closed(pairs.T_base_gripper, pairs.T_camera_target, False).linearised(STANDING, HELD)
    likelihood = _Likelihood(Covariances(scatter, at), rows, np.linspace(0.4, 1.4, 9))
    sizes = likelihood.covariances.prior()[:, 0] + 0.2
    expected = approx_fprime(sizes, lambda s: likelihood(s)[0], 1e-6)
    assert likelihood(sizes)[1] == pytest.approx(expected, rel=1e-4, abs=1e-3)
