"""What a cell uses of a calibration: effective joint offsets, the lens, and the joint covariance of all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.hand_eye.chain import OFFSETS, smooth_errors
from calib.hand_eye.result import HandEye, _given
from recorded.arm_sets import NOMINAL, TARGETS, draw_truth, recorded, wide


@pytest.fixture(scope="module")
def found() -> HandEye:
    rng = np.random.default_rng(51)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 20, rng)
    loose = joints + np.radians(0.02) * rng.standard_normal(joints.shape)
    return calibrate_hand_eye(replace(recorded(truth, loose, "charuco", rng), joints=frozen(joints)))


def test_the_covariance_is_that_of_camera_arm_and_lens(found: HandEye) -> None:
    C = found.covariance
    assert C.shape == (39, 39)
    assert np.abs(C - C.T).max() <= 1e-12 * np.abs(C).max()
    assert np.sqrt(np.diag(C))[:3] == pytest.approx(np.sqrt(np.diag(found.chain.covariance))[:3], rel=0.02)
    assert np.sqrt(C[7, 7]) < np.radians(0.2)
    assert not C[-9:].any(), "this lens counts as exact"
    assert found.camera.lens_digest == found.recording.camera.lens_digest


def test_offsets_have_the_mean_of_the_smooth_errors(found: HandEye) -> None:
    x = found.chain.fit.unknowns.copy()
    first = OFFSETS + 24
    waves = smooth_errors(NOMINAL)
    x[first : first + len(waves)] = np.radians(0.01) * np.arange(1, len(waves) + 1)
    other = replace(found, chain=replace(found.chain, fit=replace(found.chain.fit, unknowns=x)))
    used = found.recording.joints[found.chain.fit.weights[0] > 0.0]
    for joint in range(6):
        mean = sum(
            x[first + k] * wave.gain(used).mean() for k, wave in enumerate(waves) if wave.joint == joint
        )
        assert other.joint_offsets[joint] == pytest.approx(x[OFFSETS + joint] + mean)
    assert (other.joint_scatter > found.joint_scatter).all(), "what varies about the mean is left as scatter"
    assert found.chain.scattering is not None
    assert (found.joint_scatter > found.chain.scattering.sizes.scatter).all()


def test_what_is_known_no_longer_varies_and_tells_of_the_rest() -> None:
    L = np.random.default_rng(1).normal(size=(4, 4))
    C = L @ L.T
    left = _given(C, np.array([0, 3]))
    assert left[[0, 3]] == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.inv(left[1:3, 1:3]) == pytest.approx(np.linalg.inv(C)[1:3, 1:3])
