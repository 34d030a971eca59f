"""Planted faults of recordings: refused or named, by the right cause; complete recordings are neither."""

import re
from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from calib.chain.result import ChainLimits, chi2_limit
from calib.chain.score_tests import ChainErrorHypothesis
from calib.chain.verdict import LEAST_NOISE_PX, with_verdict
from calib.hand_eye.calibrate import calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, spoilt, wide
from recorded.faults import faulty


@pytest.mark.slow
def test_two_halves_that_do_not_fit_each_other_are_told_even_if_one_alone_fits():
    recording, _ = faulty("camera moves 1 mm half way", seed=2, count=40)
    c = calibrate_hand_eye(recording).chain
    assert not c.accepted
    assert any("movement of the camera" in reason for reason in c.reasons)


def test_a_sudden_change_is_a_reason_of_its_own():
    """Whatever else fits: one half of the images was left out as wrong."""
    rng = np.random.default_rng(5)
    truth = draw_truth(rng)
    c = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS["marker"], 12, rng), "marker", rng)).chain
    assert c.accepted
    changed = with_verdict(replace(c, change=7), lambda name, value: f"{name} {value}")
    assert changed.reasons == ("images from number 7 on do not fit the earlier ones",)
    moved = ChainErrorHypothesis("camera moved", 1e-3, 1e-5, "m", 900.0, 10.0, 1e-3, 7)
    named = with_verdict(replace(c, change=7, hypotheses=(moved,)), lambda name, value: f"{name} {value}")
    assert len(named.reasons) == 1
    assert (
        "earlier ones: most likely a movement of the camera by about 1.00 mm before image 7"
        in named.reasons[0]
    )


def test_corners_without_noise_are_told_as_implausible():
    rng = np.random.default_rng(5)
    truth = draw_truth(rng)
    exact = recorded(truth, wide(truth, TARGETS["marker"], 12, rng), "marker", rng, 0.3 * LEAST_NOISE_PX)
    c = calibrate_hand_eye(exact).chain
    assert "were these corners computed?" in c.remarks[0]
    noisy = replace(c, problem=replace(c.problem, pixel_sigma=np.array([0.3, 3.0]) * LEAST_NOISE_PX))
    assert "computed" not in " ".join(with_verdict(noisy, lambda name, value: f"{name} {value}").remarks)


@pytest.mark.slow
def test_each_limit_refuses_and_says_its_figure():
    rng = np.random.default_rng(5)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS["marker"], 12, rng), "marker", rng)
    at = ChainLimits(held_out=1e-3)
    assert calibrate_hand_eye(recording, at).chain.accepted
    said = {
        replace(at, images=13): "12 images are usable, at least 13 are needed",
        replace(at, held_out=1e-6): "the limit is 0.001 mm: take more images",
        replace(at, undetermined=(1e-9, 1.0)): "unknowns are not determined by these images, the worst is",
    }
    for limits, words in said.items():
        c = calibrate_hand_eye(recording, limits).chain
        assert not c.accepted
        assert len(c.reasons) == 1
        assert words in c.reasons[0]
    spoilt_one, _ = spoilt(recording, 0.25, "shifted", rng)
    c = calibrate_hand_eye(spoilt_one, replace(at, wrong=0.2)).chain
    assert "3 of 12 images do not fit the others, at most 20 % may" in c.reasons[0]


def test_the_limit_of_chi2_allows_for_chance_in_few_images_only():
    limits = ChainLimits()
    assert chi2_limit(limits, 500, 1500, 500.0) == limits.chi2_dof
    assert chi2_limit(limits, 0, 2000, np.inf) == limits.chi2_dof
    assert chi2_limit(limits, 16, 32, 16.0) > 3.0
    assert 1.5 < chi2_limit(limits, 0, 30, np.inf) < 2.5
    # an honest ratio stays below it: noise from 16 coordinates, 48 in all
    rng = np.random.default_rng(6)
    known, more = rng.chisquare(16, 20_000), rng.chisquare(32, 20_000)
    ratio = (known + more) / 48 / (known / 16)
    assert (ratio > chi2_limit(limits, 16, 32, 16.0)).mean() < 1e-3
    assert (ratio > 0.6 * chi2_limit(limits, 16, 32, 16.0)).mean() > 1e-3


@pytest.mark.slow
def test_an_arm_that_scatters_more_than_cubes_allow_is_refused_and_no_other():
    rng = np.random.default_rng(7)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 30, rng)
    off = rng.standard_normal(joints.shape)
    for scatter_deg, accepted in ((0.03, True), (0.12, False)):
        loose = joints + np.radians(scatter_deg) * off
        recording = replace(recorded(truth, loose, "charuco", rng), joints=frozen(joints))
        found = calibrate_hand_eye(recording)
        assert found.chain.accepted == accepted
        assert np.degrees(np.sqrt(np.mean(found.joint_scatter**2))) == pytest.approx(scatter_deg, rel=0.3)
    assert "the tool would miss holes" in " ".join(found.chain.reasons)
    assert "the arm's own scatter" in " ".join(found.chain.reasons)


def named_links(c):
    return any(trial.needed for trial in c.trials)


@pytest.mark.slow
def test_a_size_that_links_make_up_for_widens_what_is_said_and_is_asked_about():
    """A target 0.3 % larger than its file says, three times what a maker is off by: links all longer fit as well."""
    asked = 0
    for seed in range(3):
        rng = np.random.default_rng([seed, 7])
        truth = draw_truth(rng, links=True)
        recording = recorded(truth, wide(truth, TARGETS["charuco"], 30, rng), "charuco", rng)
        right = calibrate_hand_eye(recording)
        wrong = calibrate_hand_eye(replace(recording, points=frozen(0.997 * recording.points)))
        assert named_links(wrong.chain)
        off = np.linalg.norm(wrong.T_base_camera[:3, 3] - truth.T_base_camera[:3, 3])
        assert 1.5e-3 < off < 4.5 * float(np.linalg.norm(wrong.camera_sigma[0]))
        said = " ".join((*wrong.chain.reasons, *wrong.chain.remarks))
        asked += bool(re.search("target's size: the one in the images is 0.[234].* % larger", said))
        assert right.chain.accepted
        assert "target's size" not in " ".join(right.chain.remarks)
    assert asked >= 2


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 2))])
def test_an_arm_that_scatters_is_told_and_widens_what_is_said(seed):
    """0.004 deg of scatter in every joint: of all squares hardly a fifth more, and twice the arm's own."""
    rng = np.random.default_rng([seed, 8])
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 60, rng)
    loose = joints + np.radians(0.004) * rng.standard_normal(joints.shape)
    c = calibrate_hand_eye(replace(recorded(truth, loose, "charuco", rng), joints=frozen(joints))).chain
    assert c.accepted
    assert c.fit.chi2_dof < 1.3
    assert np.degrees(np.sqrt(np.mean(c.scattering.sizes.scatter**2))) == pytest.approx(0.004, rel=0.3)
    assert "the arm scatters by 0.00" in c.remarks[0]
    assert not [s.name for s in c.hypotheses if s.sure], "scatter is no cause"
    exact = calibrate_hand_eye(recorded(truth, joints, "charuco", rng)).chain
    widened = np.sqrt(np.diag(c.covariance) / np.diag(exact.covariance).clip(1e-30))[exact.problem.free]
    assert np.median(widened) > 1.5


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [(0, 1), pytest.param((2, 3), marks=pytest.mark.slow)])
def test_what_is_complete_has_no_excess(seeds):
    for seed in seeds:
        rng = np.random.default_rng([seed, 9])
        truth = draw_truth(rng)
        recording = recorded(truth, wide(truth, TARGETS["charuco"], 24, rng), "charuco", rng)
        spoilt_one, _ = spoilt(recording, 0.25 * (seed % 2), "shifted", rng)
        c = calibrate_hand_eye(spoilt_one).chain
        assert c.excess == pytest.approx(1.0, abs=0.35)
        assert c.excess < c.excess_limit


def coarse(count, seed):
    rng, step = np.random.default_rng([seed, 10]), np.radians(0.1)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], count, rng)
    read = np.rint(joints / step) * step
    return replace(recorded(truth, joints, "charuco", rng), joints=frozen(read)), truth, read


@pytest.mark.slow
def test_steps_of_encoders_are_believed_of_few_poses_and_always_if_they_were_given():
    recording, _, _ = coarse(8, 2)
    assert (calibrate_hand_eye(recording).chain.problem.reading_sigma > 0.0).any()
    step = np.radians(0.1)
    for count in (9, 16):
        rng = np.random.default_rng(count)
        _, truth, read = coarse(count, 2)
        commanded = recorded(truth, read, "charuco", rng)  # exact readings, on a grid
        given = calibrate_hand_eye(commanded, encoder_step=step).chain.problem.reading_sigma
        assert given == pytest.approx(step / np.sqrt(12.0))
    assert (calibrate_hand_eye(commanded).chain.problem.reading_sigma == 0.0).all()


def test_too_few_images_are_the_only_reason():
    rng = np.random.default_rng(11)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS["marker"], 5, rng), "marker", rng)
    reasons = calibrate_hand_eye(recording, ChainLimits(held_out=1e-9)).chain.reasons
    assert reasons == ("5 images are usable, at least 8 are needed",)
