"""Plans of a NAO's measurement: what is chosen can be done and seen, and says what it is said to say."""

import numpy as np
import pytest
from nao_paper_bench.stance_design import plan_stances, random_stances, stance_informations
from nao_paper_bench.stance_pool import (
    find_stances,
)

from arm.errors import ImpossibleError, InputError
from calib.chain.fit import fit_chains
from calib.nao.chain import SIDES, gravity_torques, nao_sightings
from recorded.nao_scenes import ALL, BOARD, CAMERA, ON_ITS_BACK, PAPER, SENSING, problem

pytestmark = pytest.mark.xdist_group("stances")  # one process finds the pool


def test_information_is_that_of_the_fit(pool):
    """Of the same stances, by the fit's own elimination of the readings' errors."""
    some = [s for side in SIDES for s in pool if s.side == side][::10]
    found = []
    for side in SIDES:
        of = [s for s in some if s.side == side]
        leg = np.repeat([s.leg for s in of], 3, axis=0)
        head = np.concatenate([s.heads for s in of])
        which = np.repeat(np.arange(len(of)), 3)
        blind = nao_sightings(
            side, PAPER, which, leg, head, BOARD, np.zeros((len(which), 24, 2)), ON_ITS_BACK
        )
        T = blind.evaluate(np.zeros(21), np.zeros((len(which), 8))).T
        pixels = CAMERA.project(np.einsum("nij,mj->nmi", T[:, :3, :3], BOARD) + T[:, None, :3, 3])
        found.append(nao_sightings(side, PAPER, which, leg, head, BOARD, pixels, ON_ITS_BACK))
    fit = fit_chains(problem(found, PAPER))
    total = stance_informations(some, SENSING, PAPER).sum(axis=0)
    scale = np.sqrt(np.diag(fit.information))
    assert total / np.outer(scale, scale) == pytest.approx(fit.information / np.outer(scale, scale), abs=1e-6)


def test_four_planned_stances_say_more_than_four_random_ones(pool):
    planned = plan_stances(pool, 4, SENSING, PAPER, rounds=1)
    drawn = [
        random_stances(pool, 4, SENSING, PAPER, np.random.default_rng(k)).joint_sigma_deg for k in range(9)
    ]
    assert [s.side for s in planned.stances].count("L") == 4
    assert planned.joint_sigma_deg < 0.6 * np.median(drawn)
    assert planned.joint_sigma_deg < 0.034
    assert len({id(s) for s in planned.stances}) == 8


def test_stances_near_the_chosen_ones_better_them(pool):
    still = plan_stances(pool, 4, SENSING, PAPER, rounds=0)
    moved = plan_stances(pool, 4, SENSING, PAPER, rounds=2)
    assert moved.joint_sigma_deg < 0.97 * still.joint_sigma_deg


def test_a_plan_for_play_turns_the_torques_over(pool):
    """With no sign of a torque changed, play cannot be told from an offset."""
    guess = np.where(["backlash" in n for n in ALL.names], np.radians(0.5), 0.0)
    plan = plan_stances(pool, 8, SENSING, ALL, guess, rounds=0)
    for side in SIDES:
        torque, could = (
            gravity_torques(side, np.array([s.leg for s in of if s.side == side]), ON_ITS_BACK)
            for of in (plan.stances, pool)
        )
        both = (could < 0.0).any(axis=0) & (could > 0.0).any(axis=0)
        assert both.sum() >= 4  # in few stances of a robot on its back hip and knee bear no weight
        assert (torque.min(axis=0) < 0.0)[both].all()
        assert (torque.max(axis=0) > 0.0)[both].all()


def test_the_criteria_do_what_they_are_named_for(pool):
    a, d = (plan_stances(pool, 3, SENSING, PAPER, criterion=c, rounds=0) for c in "AD")
    assert a.joint_sigma_deg < d.joint_sigma_deg
    scale = 1.0 / np.sqrt(np.diag(d.information))
    volumes = [np.linalg.slogdet(p.information * np.outer(scale, scale))[1] for p in (a, d)]
    assert volumes[0] < volumes[1]


def test_what_cannot_be_planned_is_told(pool):
    with pytest.raises(InputError, match="side = 'left': must be L or R"):
        find_stances("left", CAMERA, 1, np.random.default_rng(0))
    with pytest.raises(ImpossibleError, match="50 stances of each leg are needed, but the pool has 40"):
        plan_stances(pool, 50, SENSING, PAPER)
    with pytest.raises(ImpossibleError, match="only 0 of 1 stances of leg L"):
        find_stances("L", CAMERA, 1, np.random.default_rng(0), margin_px=235.0)
