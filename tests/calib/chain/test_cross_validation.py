"""What is held out is predicted from the rest: as well as its noise allows if the model is complete, and only then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calib.chain.cross_validation as cross_validation
from arm.se3 import Array, frozen
from calib.chain.cross_validation import FOLDS, cross_validate
from calib.chain.fit import Sightings, fit_chains
from calib.chain.model_selection import Choice
from calib.chain.result import ChainCalibration
from calib.chain.verdict import with_verdict
from calib.hand_eye.calibrate import calibrate_hand_eye
from recorded.arm_sets import TARGETS, draw_truth, recorded, wide
from vision.camera.model import Camera
from vision.camera.projection import Projection

NOISE_PX = 0.3


def found(links: bool) -> ChainCalibration:
    rng = np.random.default_rng(12)
    truth = draw_truth(rng, links=links)
    joints = wide(truth, TARGETS["charuco"], 40, rng)
    return calibrate_hand_eye(recorded(truth, joints, "charuco", rng, NOISE_PX)).chain


@pytest.fixture(scope="module")
def plain() -> ChainCalibration:
    return found(links=False)


def shifted(c: ChainCalibration, by: Array, weights: Array) -> Choice:
    """Images that are off their predictions by (n, 2) px, each corner a little more or less; the lens is not square."""
    s = c.problem.sightings[0]
    camera = replace(c.problem.camera, K=frozen([[2000.0, 0, 900], [0, 4000.0, 500], [0, 0, 1]]))
    strewn = np.where(np.arange(len(s.points)) % 2 == 0, 3.0, -3.0)[:, None]
    pixels = camera.project(predicted(c)) + by[:, None] + strewn
    problem = replace(c.problem, camera=camera, sightings=[replace(s, pixels=pixels)])
    return Choice(problem, replace(c.fit, weights=(weights,)), ())


def predicted(c: ChainCalibration) -> Array:
    """The target's points before the camera, (n, m, 3) m."""
    s = c.problem.sightings[0]
    T = s.evaluate(c.fit.unknowns, np.zeros_like(s.readings)).T
    return np.asarray(np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3])


def test_figures_are_of_the_images_that_are_believed_in_px_and_across_the_line_of_sight(
    plain: ChainCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_validation, "fit_chains", lambda problem, weights, fit: fit)
    n = len(plain.problem.sightings[0].readings)
    rng = np.random.default_rng(0)
    by, weights = rng.normal(size=(n, 2)) * [2.0, 6.0], np.ones(n)
    weights[[3, 20]], by[[3, 20]] = 0.0, 500.0
    held = cross_validate(shifted(plain, by, weights))
    used = weights > 0.0
    assert held.px == pytest.approx(np.sqrt(np.mean(by[used] ** 2) + 3.0**2), rel=1e-9)
    depth = predicted(plain)[used, :, 2].mean(axis=1)
    off = by[used] / [2000.0, 4000.0] * depth[:, None]
    assert held.metres == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))), rel=1e-9)


def test_corners_that_were_not_seen_and_parts_without_images_do_not_count(
    plain: ChainCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_validation, "fit_chains", lambda problem, weights, fit: fit)
    n = len(plain.problem.sightings[0].readings)
    weights = np.where(np.arange(n) % FOLDS == 2, 0.0, 1.0)
    choice = shifted(plain, np.tile([1.0, 2.0], (n, 1)), weights)
    (s,) = choice.problem.sightings
    s.pixels[0, 4:] = np.nan
    held = cross_validate(choice)
    assert held.px == pytest.approx(np.sqrt(2.5 + 3.0**2), rel=1e-9)
    assert 0.0 < held.metres < 1e-3
    none = cross_validate(replace(choice, fit=replace(choice.fit, weights=(np.zeros(n),))))
    assert np.isnan([none.px, none.metres]).all(), "what was never predicted is not accurate"
    judged_none = with_verdict(replace(plain, held_out=none), lambda name, value: name)
    assert any("held-out targets are off by nan mm" in reason for reason in judged_none.reasons)


def test_an_image_that_is_predicted_where_the_camera_sees_nothing_is_not_predicted_well(
    plain: ChainCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cross_validation, "fit_chains", lambda problem, weights, fit: fit)
    n = len(plain.problem.sightings[0].readings)
    choice = shifted(plain, np.tile([1.0, 2.0], (n, 1)), np.ones(n))
    project = Sightings.projection
    behind = iter([True])

    def one_behind(s: Sightings, camera: Camera, unknowns: Array) -> Projection:
        expected = project(s, camera, unknowns)
        if next(behind, False):
            expected.pixels[0] = np.nan
        return expected

    monkeypatch.setattr(Sightings, "projection", one_behind)
    held = cross_validate(choice)
    assert held.metres == np.inf
    assert held.px == pytest.approx(np.sqrt(2.5 + 3.0**2), rel=1e-9)
    refused = with_verdict(replace(plain, held_out=held), lambda name, value: name)
    assert any("off by more than a metre" in reason for reason in refused.reasons)


def test_a_complete_model_predicts_to_the_noise(plain: ChainCalibration) -> None:
    c = plain
    assert c.held_out.px == pytest.approx(NOISE_PX, rel=0.1)
    assert 0.0 < c.held_out.metres < 1e-4


@pytest.mark.slow
def test_a_model_that_lacks_the_links_does_not() -> None:
    c = found(links=True)
    free = c.problem.free.copy()
    free[18:] = False
    poorer = replace(c.problem, free=free)
    fit = fit_chains(poorer, c.fit.weights)
    fitted = float(np.sqrt(np.mean(fit.residuals[0] ** 2)))
    held = cross_validate(Choice(poorer, fit, ()))
    assert held.px > 2.0 * NOISE_PX
    assert held.px > 1.05 * fitted  # what is fitted always looks better than what is predicted
    assert held.metres > 3.0 * c.held_out.metres


def test_every_image_is_held_out_once_and_with_all_of_its_stance(
    plain: ChainCalibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    c = plain
    s = c.problem.sightings[0]
    stances = np.arange(len(s.readings)) // 3
    problem = replace(c.problem, sightings=[replace(s, stances=stances)])
    used = []

    def noted(problem, weights, begin):  # type: ignore[no-untyped-def]
        used.append(weights[0] > 0.0)
        return fit_chains(problem, weights, begin)

    monkeypatch.setattr(cross_validation, "fit_chains", noted)
    cross_validate(Choice(problem, c.fit, ()))
    out = ~np.array(used)
    assert len(out) == FOLDS
    assert (out.sum(axis=0) == 1).all()
    for fold in out:
        assert np.ptp(stances[fold]) >= FOLDS  # from all over the recording
        assert all(fold[stances == k].all() or not fold[stances == k].any() for k in np.unique(stances))
