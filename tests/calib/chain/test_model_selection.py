"""Parts of a model that mean nothing are left out; images that are wrong are, right ones are not."""

import numpy as np
import pytest

from calib.chain.model_selection import Part, choose_model, largest_rise
from calib.hand_eye.calibrate import calibrate_hand_eye, hand_eye_problem
from calib.model.chi_square import chi2_limit
from recorded.arm_sets import TARGETS, draw_truth, recorded, spoilt, wide

LINKS = tuple(range(18, 36))


def problem(seed, links, count=24):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng, links=links)
    recording = recorded(truth, wide(truth, TARGETS["charuco"], count, rng), "charuco", rng)
    about = truth.T_base_camera, truth.T_gripper_target
    return hand_eye_problem(recording, about, np.full(2, 0.3), np.zeros(6)), truth


def test_a_part_is_kept_only_if_the_images_show_it():
    parts = [Part("links", LINKS), Part("lengths a", tuple(range(24, 30)))]
    plain, _ = problem(1, False)
    choice = choose_model(plain, parts[:1])
    assert [trial.needed for trial in choice.trials] == [False]
    assert not choice.problem.free[list(LINKS)].any()
    assert choice.trials[0].rise < choice.trials[0].limit == pytest.approx(chi2_limit(1e-3, 18))
    off, _ = problem(2, True)
    choice = choose_model(off, parts[:1])
    assert [trial.needed for trial in choice.trials] == [True]
    assert choice.problem.free[list(LINKS)].all()
    assert choice.fit.chi2_dof == pytest.approx(1.0, abs=0.2)
    assert not [len(w) for w in choice.fit.wrong if len(w)]


def test_the_part_that_is_worth_least_goes_first():
    plain, truth = problem(3, False)
    offsets = Part("zeros", (13, 14, 15, 16))
    choice = choose_model(plain, [offsets, Part("links", LINKS)])
    trials = {trial.part: trial for trial in choice.trials}
    assert trials["zeros"].needed, "without links nothing else can make up for them"
    assert not trials["links"].needed
    assert choice.fit.unknowns[13:17] == pytest.approx(truth.offsets[1:5], abs=5e-4)


def test_a_rise_allows_for_the_noise_being_estimated():
    assert largest_rise(1e-3, 18, np.inf) == pytest.approx(chi2_limit(1e-3, 18))
    assert largest_rise(1e-3, 18, 1e6) == pytest.approx(chi2_limit(1e-3, 18), rel=1e-3)
    rng = np.random.default_rng(4)
    ratio = rng.chisquare(18, 200_000) / (rng.chisquare(24, 200_000) / 24)
    assert (ratio > largest_rise(1e-3, 18, 24.0)).mean() == pytest.approx(1e-3, rel=0.3)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(4))
def test_a_quarter_of_twelve_markers_may_be_wrong(seed):
    rng = np.random.default_rng([seed, 12, 3])
    truth = draw_truth(rng)
    clean = recorded(truth, wide(truth, TARGETS["marker"], 12, rng), "marker", rng)
    recording, wrong = spoilt(clean, 0.25, "shifted", rng)
    found = calibrate_hand_eye(recording)
    assert found.chain.wrong[0].tolist() == wrong.tolist()
    assert found.chain.accepted, found.chain.reasons
