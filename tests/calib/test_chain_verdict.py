"""Planted faults of recordings: refused or named, by the right cause; complete recordings are neither."""

from dataclasses import replace

import numpy as np
import pytest

from arm.se3 import frozen
from arm_sets import TARGETS, draw_truth, recorded, spoilt, wide
from calib.chain_calibration import ChainLimits, chi2_limit
from calib.chain_suspects import sudden_change
from calib.chain_verdict import describe
from calib.hand_eye import calibrate_hand_eye
from recorded_faults import FAULTS


def faulty(name, seed=1, count=30, kind="charuco"):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng)
    return FAULTS[name][0](truth, wide(truth, TARGETS[kind], count, rng), kind, rng), truth


@pytest.mark.parametrize("name", list(FAULTS))
def test_the_cause_is_named(name):
    recording, truth = faulty(name)
    c = calibrate_hand_eye(recording).chain
    suspect = c.suspects[0]
    assert suspect.sure
    assert suspect.name == FAULTS[name][1]
    told = describe(suspect)
    assert told in " ".join((*c.reasons, *c.remarks))
    s = c.problem.sightings[0]
    T = s.chain.evaluate(recording.joints, c.fit.unknowns).T
    off = np.sqrt(np.mean(np.sum((T - truth.T_camera_target(recording.joints))[:, :3, 3] ** 2, axis=1)))
    if c.accepted:
        assert off < 1.1 * c.limits.held_out, "accepted only if targets are where they are predicted"
    if "moved" in suspect.name:
        assert not c.accepted
        assert suspect.image == pytest.approx(15, abs=3)
        assert suspect.amount == pytest.approx(1e-3, rel=0.25)
    elif "geared" in name:
        assert suspect.amount == pytest.approx(0.002, abs=4.0 * suspect.sigma)
    elif "larger" in name:
        assert not c.accepted, "no residual shows it, and all is a hundredth too near"
        assert suspect.amount == pytest.approx(0.01, abs=1e-3)
        assert suspect.moves == pytest.approx(off, rel=0.1)
        assert suspect.moves > 5e-3


@pytest.mark.parametrize("kind", ["charuco", "marker"])
def test_nothing_is_suspected_of_what_is_complete(kind):
    for seed in range(3):
        rng = np.random.default_rng([seed, 4])
        truth = draw_truth(rng, links=seed == 2)
        c = calibrate_hand_eye(recorded(truth, wide(truth, TARGETS[kind], 24, rng), kind, rng)).chain
        assert c.accepted, c.reasons
        assert not [s.name for s in c.suspects if s.sure]
        assert c.change is None
        assert not any("worth a look" in remark for remark in c.remarks)


def test_two_halves_that_do_not_fit_each_other_are_told_even_if_one_alone_fits():
    recording, _ = faulty("camera moves 1 mm half way", seed=2, count=40)
    c = calibrate_hand_eye(recording).chain
    assert not c.accepted
    assert any("camera moved" in reason for reason in c.reasons)


def test_a_change_is_told_from_wrong_images_that_are_strewn():
    wrong = np.zeros(40, dtype=bool)
    assert sudden_change(wrong) is None
    assert sudden_change(wrong[:1]) is None
    wrong[23:] = True
    assert sudden_change(wrong) == 23
    assert sudden_change(~wrong) == 23
    wrong[[25, 31]] = False
    wrong[4] = True
    assert sudden_change(wrong) == 23
    for seed in range(200):
        assert sudden_change(np.random.default_rng(seed).random(40) < 0.3) is None


def test_each_limit_refuses_and_says_its_figure():
    rng = np.random.default_rng(5)
    truth = draw_truth(rng)
    recording = recorded(truth, wide(truth, TARGETS["marker"], 12, rng), "marker", rng)
    at = ChainLimits(held_out=1e-3)
    assert calibrate_hand_eye(recording, at).chain.accepted
    said = {
        replace(at, images=13): "12 images can be used, at least 13 are needed",
        replace(at, held_out=1e-6): "the limit is 0.001 mm: more images",
        replace(at, undetermined=(1e-9, 1.0)): "unknowns are not determined by these images, least of all",
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
    assert chi2_limit(limits, 2000, 500.0) == limits.chi2_dof
    assert chi2_limit(limits, 2000, np.inf) == limits.chi2_dof
    assert chi2_limit(limits, 48, 16.0) > 3.0
    assert 1.5 < chi2_limit(limits, 30, np.inf) < 2.5
    # an honest ratio stays below it: noise from 16 coordinates, 48 in all
    rng = np.random.default_rng(6)
    known, more = rng.chisquare(16, 20_000), rng.chisquare(32, 20_000)
    ratio = (known + more) / 48 / (known / 16)
    assert (ratio > chi2_limit(limits, 48, 16.0)).mean() < 1e-3
    assert (ratio > 0.6 * chi2_limit(limits, 48, 16.0)).mean() > 1e-3


def test_an_arm_with_more_wrong_than_is_known_of_is_refused():
    rng = np.random.default_rng(7)
    truth = draw_truth(rng)
    joints = wide(truth, TARGETS["charuco"], 30, rng)
    loose = joints + np.radians(0.03) * rng.standard_normal(joints.shape)
    recording = replace(recorded(truth, loose, "charuco", rng), joints=frozen(joints))
    c = calibrate_hand_eye(recording).chain
    assert not c.accepted
    assert "times what the noise of corners and encoders makes" in " ".join(c.reasons)
    assert c.fit.chi2_dof > c.chi2_limit
    assert np.sqrt(np.diag(c.covariance)).max() > np.sqrt(np.diag(c.fit.covariance(c.problem.free))).max()
