"""Play and springs of a NAO's legs: which shape the play has, what stances do not tell, and feet that meet commands."""

from dataclasses import replace

import numpy as np
import pytest
from nao_paper_bench.kinematics import STANDING, NaoKinematics, masses_off, standing_error

from calib.chain.fit import fit_chains
from calib.nao.backlash import (
    MASS_SIGMA,
    fit_compliance_and_backlash,
    torque_sigmas,
    with_first_priors,
    with_priors_of_a_make,
)
from calib.nao.chain import (
    LEG,
    SIDES,
    KnownSides,
    NaoUnknowns,
    gravity_torques,
    nao_model,
    nao_sightings,
)
from recorded.nao_scenes import (
    ALL,
    BOARD,
    CAMERA,
    ON_ITS_BACK,
    PAPER,
    PIXEL_SIGMA,
    STEP,
    bent_legs,
    problem,
    sightings,
    truth,
)

D = np.pi / 180.0


def images(seed, hard, off=0.0, stances=24):
    """Of a robot with everything, as `nao_scenes.sightings`, but with play that may be hard and masses that are off."""
    rng = np.random.default_rng(seed)
    smooth, _ = sightings(seed, ALL, ALL, stances, step=0.0)
    x = truth(ALL, np.random.default_rng(seed))
    model = masses_off(off, rng) if off else None
    rigid = x[:23] * np.array(
        [not n.startswith(("L", "R")) or "Rot" in n or "Tra" in n for n in ALL.names[:23]]
    )
    found = []
    for side, s in zip(SIDES, smooth, strict=True):
        legs = bent_legs(side, s.readings[:, :6], x, ON_ITS_BACK, hard, model)
        at = np.column_stack([legs, s.readings[:, 6:]])
        stiff = NaoUnknowns(head=True)
        blind = nao_sightings(side, stiff, s.stances, legs, s.readings[:, 6:], BOARD, s.pixels, ON_ITS_BACK)
        T = blind.chain.evaluate(at, rigid).T
        pixels = CAMERA.project(np.einsum("nij,mj->nmi", T[:, :3, :3], BOARD) + T[:, None, :3, 3])
        pixels += PIXEL_SIGMA * rng.standard_normal(pixels.shape)
        read = np.rint(s.readings / STEP) * STEP
        found.append(
            nao_sightings(side, ALL, s.stances, read[:, :6], read[:, 6:], BOARD, pixels, ON_ITS_BACK)
        )
    return found, x, model


@pytest.mark.few(1)
@pytest.mark.parametrize(("hard", "off"), [(False, 0.0), (True, 0.1)])
def test_the_shape_of_play_is_found(hard, off):
    """Hard play with masses 10 % off too: chi2 is about 1 only with the right shape."""
    found, x, model = images(4, hard, off, stances=18)
    fit = fit_compliance_and_backlash(problem(found, ALL), ALL, SIDES, ON_ITS_BACK)
    assert fit.hard == hard
    right, wrong = (fit.hard_cost, fit.smooth_cost) if hard else (fit.smooth_cost, fit.hard_cost)
    assert right < wrong - 50.0
    assert wrong / fit.fit.freedom > 1.03
    assert fit.fit.chi2_dof == pytest.approx(1.0, abs=0.06)
    true = NaoKinematics(ALL, x, hard, True, model)
    assert standing_error(true, NaoKinematics(ALL, fit.fit.unknowns, hard)).rms < 1e-3


@pytest.mark.slow
def test_play_that_no_stance_shows_is_taken_from_the_other_joints():
    found, x = sightings(3, ALL, ALL)
    torque = gravity_torques("L", found[0].readings[:, :6], ON_ITS_BACK)
    assert (torque[:, 2] > 0.05).all()  # the hip's never changes sign
    first = with_first_priors(problem(found, ALL), ALL)
    known = with_priors_of_a_make(first, ALL, fit_chains(first))
    at = [i for i, name in enumerate(ALL.names) if "backlash" in name]
    assert np.abs(fit_chains(known).unknowns - x)[at].max() / D < 0.4
    assert 0.2 < known.start[at[0]] / D < 0.6
    assert known.prior_sigma[at[0]] / D < 0.4


def test_sides_are_those_of_the_stance_and_elsewhere_of_the_torque():
    legs = np.array([np.zeros(6), np.full(6, 0.5)])
    known = KnownSides(legs, np.array([np.ones(6), -np.ones(6)]))
    asked = np.array([legs[1] + 0.003, legs[0] - 0.003, legs[1] + 0.1])
    torque = np.tile([1.0, -1.0, 1.0, -1.0, 1.0, -1.0], (3, 1))
    assert np.array_equal(known.at(asked, torque), [-np.ones(6), np.ones(6), torque[2]])


def test_without_play_no_shape_is_looked_for():
    found, x = sightings(2, PAPER, PAPER)
    fit = fit_compliance_and_backlash(problem(found, PAPER), PAPER, SIDES, ON_ITS_BACK)
    assert not fit.hard
    assert np.abs(fit.fit.unknowns - x)[3:15].max() / D < 0.1


def test_what_is_held_stays_where_it_is_held():
    """A model without play, and images of one leg alone."""
    found, x = sightings(6, NaoUnknowns(compliance=True), ALL, stances=12)
    p = problem(found[:1], ALL)
    free = np.array([name[0] in "CL" and "backlash" not in name for name in ALL.names])
    fit = fit_compliance_and_backlash(replace(p, free=free), ALL, "L", ON_ITS_BACK)
    assert not fit.hard
    assert (fit.fit.unknowns[~free] == 0.0).all()
    assert fit.fit.chi2_dof == pytest.approx(1.0, abs=0.08)
    springs = [ALL.names.index(f"L{j}_compliance_deg_per_Nm") for j in LEG[:3]]
    true = x[[NaoUnknowns(compliance=True).names.index(f"L{j}_compliance_deg_per_Nm") for j in LEG[:3]]]
    assert np.abs(fit.fit.unknowns[springs] - true).max() / D < 0.2


def test_torques_are_as_sure_as_masses():
    legs = np.random.default_rng(5).uniform(-0.6, 0.6, (3, 6))
    drawn = []
    rng = np.random.default_rng(6)
    for _ in range(300):
        model = nao_model().copy()
        for i in range(1, model.njoints):
            model.inertias[i].mass = model.inertias[i].mass * (1.0 + MASS_SIGMA * rng.standard_normal())
        drawn.append(gravity_torques("R", legs, STANDING, model))
    told = torque_sigmas("R", legs, STANDING)
    assert np.sqrt(np.var(drawn, axis=0) + 0.005**2) == pytest.approx(told, rel=0.2)
