"""The hand-eye verdict: at the tool, beyond a prior, or beyond the arm's scatter; each says what would settle it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.chain.score_tests import ChainErrorHypothesis
from calib.hand_eye.calibrate import HAND_EYE_LIMITS, calibrate_hand_eye
from calib.hand_eye.result import HandEye, ToolError
from calib.hand_eye.verdict import WorkPlace, with_hand_eye_verdict
from calib.recordings.arm import ArmRecording
from recorded.arm_sets import LENS, TARGETS, draw_truth, recorded, wide
from recorded.real_arms import draw_real_arm

SIGMA = np.array([5.0, 5.0, 8.0, 8.0, 0.005, 0.05, 1e-4, 1e-4, 0.2])


@pytest.fixture(scope="module")
def loose() -> HandEye:
    rng = np.random.default_rng(31)
    truth = draw_truth(rng)
    arm, joints = draw_real_arm(rng, truth), wide(truth, TARGETS["charuco"], 24, rng)
    seen = recorded(truth, arm.rest(joints, rng), "charuco", rng, arm.noise_px)
    return calibrate_hand_eye(replace(seen, joints=frozen(joints)))


def judged(found: HandEye, **limits: float) -> HandEye:
    bare = replace(found, chain=replace(found.chain, reasons=(), remarks=()))
    return with_hand_eye_verdict(bare, replace(HAND_EYE_LIMITS, **limits), WorkPlace())


def test_a_real_arm_is_accepted_and_its_scatter_is_told(loose: HandEye) -> None:
    assert loose.chain.accepted, loose.chain.reasons
    assert "the arm scatters by" in loose.chain.remarks[0]
    assert f"{1e3 * loose.tool.scatter:.2f} mm at the tool" in loose.chain.remarks[0]


def test_the_tool_decides_in_each_direction_with_its_own_limit(loose: HandEye) -> None:
    assert not judged(loose).chain.reasons
    for direction, words in (("sideways", "mm sideways"), ("height", "mm in height")):
        (reason,) = judged(loose, **{direction: 1e-5}).chain.reasons
        assert words in reason
        assert "the limit is 0.01 mm" in reason
        assert "most of it is " in reason


def test_a_fault_is_refused_although_the_arm_scatters(loose: HandEye) -> None:
    def with_fault(name: str, amount: float, drop: float = 99.0) -> tuple[str, ...]:
        fault = ChainErrorHypothesis(name, amount, 1e-4, "", drop, 20.0)
        return judged(replace(loose, chain=replace(loose.chain, hypotheses=(fault,)))).chain.reasons

    assert (
        "more is wrong than the arm's scatter: a movement of the camera"
        in with_fault("camera moved", 1e-3)[0]
    )
    assert "the timing" in with_fault("time skew", 0.02)[0]
    assert "scale of J4" in with_fault("scale of J4", 2e-3)[0]
    assert not with_fault("scale of J4", 2e-4), "a healthy gear"
    assert not with_fault("camera moved", 1e-3, drop=19.0)
    within = 3.0 * loose.tool.scatter
    assert within < 0.5e-3
    assert with_fault("target moved", 1.01 * within)
    assert not with_fault("target moved", 0.99 * within), "what the arm does anyway"


def with_lens(sigmas_off: float) -> ArmRecording:
    rng = np.random.default_rng(32)
    truth = draw_truth(rng)
    seen = recorded(truth, wide(truth, TARGETS["charuco"], 20, rng), "charuco", rng)
    K = LENS.K.copy()
    K[[0, 1], [0, 1]] += sigmas_off * SIGMA[:2]
    return replace(seen, camera=replace(LENS, K=K, lens_covariance=np.diag(SIGMA**2)))


@pytest.mark.slow
def test_a_lens_is_refined_within_its_covariance_and_refused_beyond() -> None:
    found = calibrate_hand_eye(with_lens(1.0))
    assert found.chain.accepted, found.chain.reasons
    off = found.camera.K[0, 0] - LENS.K[0, 0]
    told = np.sqrt(found.covariance[-9, -9])
    assert told < 0.8 * SIGMA[0]
    assert abs(off) < 4.0 * told
    far = calibrate_hand_eye(with_lens(30.0))
    assert "the lens in the images is not that of the camera file" in " ".join(far.chain.reasons)


def test_without_a_reachable_hole_nothing_is_claimed(loose: HandEye) -> None:
    far = with_hand_eye_verdict(loose, HAND_EYE_LIMITS, WorkPlace(np.array([[9.0, 9.0, 9.0]])))
    assert far.tool.holes == 0
    assert isinstance(far.tool, ToolError)
    assert "at the tool unknown" in " ".join(far.chain.remarks)
