"""The self-test: sound calibrations pass, and one whose errors are larger than it says does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.dh import A465
from arm.se3 import frozen, rotation, transform
from calib.arm_chain import arm_chain, unknown_names
from calib.arm_recording import ArmRecording
from calib.chain_calibration import ChainCalibration
from calib.hand_eye import calibrate_hand_eye
from calib.twin import self_test
from vision.camera import Camera

SIGMA = 0.3


@pytest.fixture(scope="module")
def calibration() -> ChainCalibration:
    rng = np.random.default_rng(4)
    lens = Camera(
        np.array([[1500.0, 0.0, 960.0], [0.0, 1500.0, 600.0], [0.0, 0.0, 1.0]]),
        np.zeros(5),
        (1920, 1200),
        np.eye(4),
    )
    T_base_camera = transform(rotation([np.pi, 0.0, 0.0]), (0.5, 0.0, 1.4))
    T_gripper_target = transform(rotation([0.0, 0.1, 0.0]), (0.1, 0.0, 0.1))
    points = np.array([(x, y, 0.0) for x in np.linspace(0, 0.06, 4) for y in np.linspace(0, 0.06, 4)])
    chain = arm_chain(A465, T_base_camera, T_gripper_target)
    joints = rng.uniform(-1.2, 1.2, (60, 6))
    offsets = np.zeros(len(unknown_names(6)))
    T = chain.evaluate(joints, offsets).T
    at = np.einsum("nij,mj->nmi", T[:, :3, :3], points) + T[:, None, :3, 3]
    seen = (at[..., 2] > 0.2).all(axis=1)
    pixels = lens.project(at[seen])
    pixels = pixels + rng.normal(0.0, SIGMA, pixels.shape)
    recording = ArmRecording(lens, A465, frozen(points), "points", frozen(joints[seen]), frozen(pixels))
    found = calibrate_hand_eye(recording).chain
    assert found.accepted
    return found


def test_a_sound_calibration_passes_with_every_seed(calibration: ChainCalibration) -> None:
    tests = [self_test(calibration, 4, seed) for seed in range(6)]
    assert all(t.passed for t in tests)
    assert np.mean([t.nees_dof for t in tests]) == pytest.approx(1.0, abs=0.25)
    assert max(t.worst for t in tests) < 5.0
    assert self_test(calibration, 4, 1) == tests[1]


@pytest.mark.parametrize(("times", "passes"), [(1.0, True), (2.0, False), (0.5, False)])
def test_corners_that_are_better_or_worse_than_they_are_said_to_be_are_noticed(
    calibration: ChainCalibration, monkeypatch: pytest.MonkeyPatch, times: float, passes: bool
) -> None:
    """Twins are drawn with another noise than the fit believes."""
    import calib.twin as twin

    drawn = twin._twin

    def other(problem, s, unknowns, rng):  # type: ignore[no-untyped-def]
        louder = replace(problem, pixel_sigma=times * problem.pixel_sigma)
        return drawn(louder, s, unknowns, rng)

    monkeypatch.setattr(twin, "_twin", other)
    assert self_test(calibration, 6).passed == passes
