"""What is held out is predicted from the rest: as well as its noise allows if the model is complete, and only then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib.chain_calibration as chain_calibration
from arm_sets import TARGETS, draw_truth, recorded, wide
from calib.chain_calibration import FOLDS, ChainCalibration, hold_out
from calib.chain_fit import fit_chains
from calib.hand_eye import calibrate_hand_eye
from calib.model_choice import Choice

NOISE_PX = 0.3


def found(links: bool) -> ChainCalibration:
    rng = np.random.default_rng(12)
    truth = draw_truth(rng, links=links)
    joints = wide(truth, TARGETS["charuco"], 40, rng)
    return calibrate_hand_eye(recorded(truth, joints, "charuco", rng, NOISE_PX)).chain


def test_a_complete_model_predicts_to_the_noise() -> None:
    c = found(links=False)
    assert c.held_out.px == pytest.approx(NOISE_PX, rel=0.1)
    assert 0.0 < c.held_out.metres < 1e-4


def test_a_model_that_lacks_the_links_does_not() -> None:
    c = found(links=True)
    free = c.problem.free.copy()
    free[18:] = False
    poorer = replace(c.problem, free=free)
    fit = fit_chains(poorer, c.fit.weights)
    fitted = float(np.sqrt(np.mean(fit.residuals[0] ** 2)))
    held = hold_out(Choice(poorer, fit, ()))
    assert held.px > 2.0 * NOISE_PX
    assert held.px > 1.05 * fitted  # what is fitted always looks better than what is predicted
    assert held.metres > 3.0 * c.held_out.metres


def test_every_image_is_held_out_once_and_with_all_of_its_stance(monkeypatch: pytest.MonkeyPatch) -> None:
    c = found(links=False)
    s = c.problem.sightings[0]
    stances = np.arange(len(s.readings)) // 3
    problem = replace(c.problem, sightings=[replace(s, stances=stances)])
    used = []

    def noted(problem, weights, begin):  # type: ignore[no-untyped-def]
        used.append(weights[0] > 0.0)
        return fit_chains(problem, weights, begin)

    monkeypatch.setattr(chain_calibration, "fit_chains", noted)
    hold_out(Choice(problem, c.fit, ()))
    out = ~np.array(used)
    assert len(out) == FOLDS
    assert (out.sum(axis=0) == 1).all()
    for fold in out:
        assert all(fold[stances == k].all() or not fold[stances == k].any() for k in np.unique(stances))
