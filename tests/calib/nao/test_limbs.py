"""Limbs that are not as long as the model's: named by a score test, in the model if the images show them."""

from dataclasses import replace

import numpy as np
import pytest

from calib.chain.fit import fit_chains
from calib.chain.verdict import describe
from calib.nao.calibrate import LIMBS, calibrate_nao
from calib.nao.chain import SIDES, NaoUnknowns
from calib.nao.limbs import LIMB_NAMES, find_limb_errors, limb_trial, limb_unknowns
from recorded.nao import nao_recording
from recorded.nao_scenes import CAMERA, PAPER, STEP, problem, sightings

LONGER = NaoUnknowns(limbs=True)


def without_limbs(seed, limb_m, sides=SIDES):
    """Problem and fit of the paper's model for a robot with limb errors by name, m."""
    found, x = sightings(seed, PAPER, LONGER, stances=10, step=0.0)
    plain = np.append(x, np.zeros(len(LIMB_NAMES)))
    true = plain.copy()
    true[[LONGER.names.index(name) for name in limb_m]] = list(limb_m.values())
    off = [s.projection(CAMERA, true).pixels - s.projection(CAMERA, plain).pixels for s in found]
    read = [
        replace(s, pixels=s.pixels + d, readings=np.rint(s.readings / STEP) * STEP)
        for s, d, side in zip(found, off, SIDES, strict=True)
        if side in sides
    ]
    free = np.array([n not in LIMB_NAMES and n[0] in ("C", *sides) for n in LONGER.names])
    p = replace(problem(read, LONGER), free=free)
    return p, fit_chains(p)


@pytest.mark.parametrize(
    ("name", "amount", "sides"),
    [("LThigh_mm", 0.8, SIDES), ("RHipHeight_mm", -0.8, SIDES), ("LTibia_mm", 0.8, "L")],
)
def test_a_limb_that_is_longer_is_named_with_its_amount(name, amount, sides):
    test = find_limb_errors(*without_limbs(1, {name: 1e-3 * amount}, sides), LONGER, sides)
    assert test.drop > test.limit
    limb = test.limbs[0]
    assert (limb.name, limb.sure) == (f"limb {name.removesuffix('_mm')}", True)
    assert limb.amount == pytest.approx(1e-3 * amount, abs=3.0 * limb.sigma)
    assert 0.02e-3 < limb.sigma < 0.2e-3
    assert len(test.limbs) == 5 * len(sides)
    assert not any(other.sure for other in test.limbs[1:])
    size = (
        f"{abs(1e3 * limb.amount):.2f} +- {1e3 * limb.sigma:.2f} mm {'longer' if amount > 0 else 'shorter'}"
    )
    assert f"{limb.name} is {size} than the model's" in describe(limb)


def test_limbs_of_the_right_length_are_not_named():
    for seed in (2, 3):
        test = find_limb_errors(*without_limbs(seed, {}), LONGER, SIDES)
        assert test.drop < test.limit
        assert not any(limb.sure for limb in test.limbs)


def test_limbs_enter_the_model_unless_a_target_of_another_size_explains_as_much():
    p, fit = without_limbs(2, {"LThigh_mm": 0.8e-3})
    assert limb_trial(p, fit, find_limb_errors(p, fit, LONGER, SIDES), LIMBS).needed
    p, _ = without_limbs(2, {})
    p = replace(p, sightings=[replace(s, points=1.01 * s.points) for s in p.sightings])
    test = find_limb_errors(p, fit := fit_chains(p), LONGER, SIDES)
    assert test.drop > 10.0 * test.limit
    assert not limb_trial(p, fit, test, LIMBS).needed


def test_limbs_that_are_tested_are_those_that_a_fit_finds():
    """The score test is one step of the fit: its amounts and standard deviations agree with it."""
    planted = {"LThigh_mm": 0.5e-3, "RFoot_mm": -0.4e-3}
    p, fit = without_limbs(4, planted)
    test = {limb.name: limb for limb in find_limb_errors(p, fit, LONGER, SIDES).limbs}
    limbs = limb_unknowns(LONGER, SIDES)
    prior, free = p.prior_sigma.copy(), p.free.copy()
    prior[limbs], free[limbs] = 0.5e-3, True
    whole = fit_chains(replace(p, prior_sigma=prior, free=free))
    sigma = np.sqrt(np.diag(whole.covariance(free)))
    for i in limbs:
        told = test[f"limb {LONGER.names[i].removesuffix('_mm')}"]
        assert told.amount == pytest.approx(whole.unknowns[i], abs=0.25 * sigma[i])
        assert told.sigma == pytest.approx(sigma[i], rel=0.05)


@pytest.mark.slow
def test_limbs_are_in_the_model_if_the_images_show_them(monkeypatch):
    """They are tried before compliance and backlash, which can stand in for them, and whose fit may take minutes."""
    monkeypatch.setattr("calib.nao.calibrate.fit_compliance_and_backlash", None)
    recording, x = nao_recording(2, LONGER, 8)  # head and backlash alone reach a chi2 of 1.15
    c = calibrate_nao(recording)
    assert c.accepted, c.reasons
    assert {t.part for t in c.trials if t.needed} == {LIMBS}
    places = [c.names.index(n) for n in LIMB_NAMES]
    off = c.fit.unknowns[places] - x[limb_unknowns(LONGER, SIDES)]
    assert np.abs(off / np.sqrt(np.diag(c.covariance))[places]).max() < 4.0
    assert np.abs(off).max() < 0.35e-3


@pytest.mark.slow
def test_limbs_are_told_if_they_may_not_be_in_the_model():
    recording, _ = nao_recording(5, LONGER, 8)
    c = calibrate_nao(recording, limbs=False)
    assert not c.problem.free[[c.names.index(n) for n in LIMB_NAMES]].any()
    assert any("limb " in said and "than the model's" in said for said in (*c.reasons, *c.remarks))


@pytest.mark.slow
def test_limbs_do_not_stand_in_for_a_wrong_target():
    recording, _ = nao_recording(2, PAPER, 10)
    c = calibrate_nao(replace(recording, board=recording.board * 1.01))
    assert LIMBS not in {t.part for t in c.trials if t.needed}
    assert c.hypotheses[0].name == "target size"
    assert c.hypotheses[0].amount == pytest.approx(-0.01, abs=0.002)
