"""Scatter, wrong images and the parts of the model are found together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.hand_eye.calibrate import LINKS, PRINT, calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, spoilt, wide
from recorded.real_arms import draw_real_arm


@pytest.mark.slow
def test_wrong_images_are_left_out_of_an_arm_that_scatters_and_no_others() -> None:
    rng = np.random.default_rng(61)
    truth = draw_truth(rng)
    arm, joints = draw_real_arm(rng, truth), wide(truth, TARGETS["charuco"], 24, rng)
    seen = recorded(truth, arm.rest(joints, rng), "charuco", rng, arm.noise_px)
    bad, wrong = spoilt(replace(seen, joints=frozen(joints)), 0.15, "shifted", rng)
    found = calibrate_hand_eye(bad)
    assert found.chain.wrong[0].tolist() == wrong.tolist()
    assert found.chain.accepted, found.chain.reasons
    assert found.chain.scattering is not None
    true = np.sqrt(np.mean(arm.scatter**2))
    assert np.sqrt(np.mean(found.chain.scattering.sizes.scatter**2)) == pytest.approx(true, rel=0.5)


@pytest.mark.slow
def test_a_print_of_another_size_is_estimated_and_no_link_stands_in_for_it() -> None:
    rng = np.random.default_rng(62)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 24, rng)
    loose = joints + np.radians(0.01) * rng.standard_normal(joints.shape)
    seen = recorded(truth, loose, "charuco", rng)
    grown = truth.pixels(loose, 1.003 * TARGETS["charuco"]) - truth.pixels(loose, TARGETS["charuco"])
    found = calibrate_hand_eye(replace(seen, joints=frozen(joints), pixels=frozen(seen.pixels + grown)))
    assert {t.part: t.needed for t in found.chain.trials} == {LINKS: False, PRINT: True}
    assert found.chain.accepted, found.chain.reasons
    off = np.linalg.norm(found.T_base_camera[:3, 3] - truth.T_base_camera[:3, 3])
    assert off < 4.0 * np.linalg.norm(found.camera_sigma[0])
    assert off < 1e-3
