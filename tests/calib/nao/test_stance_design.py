"""Plans of a NAO's measurement: what is chosen can be done and seen, and says what it is said to say."""

import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from calib.chain.fit import fit_chains
from calib.nao.chain import HEAD, LEG, SIDES, NaoUnknowns, gravity_torques, nao_model, nao_sightings
from calib.nao.collision import nao_bodies
from calib.nao.stance_design import Sensing, plan_stances, random_stances, stance_informations
from calib.nao.stance_pool import (
    MARGIN_PX,
    collision_free_motion,
    find_stances,
    near_stances,
    resting_posture,
)
from recorded.nao_scenes import BOARD, CAMERA, ON_ITS_BACK, PIXEL_SIGMA, STEP, problem

PAPER, ALL = NaoUnknowns(), NaoUnknowns(True, True, True)
SENSING = Sensing(CAMERA, BOARD, PIXEL_SIGMA, np.full(8, STEP / np.sqrt(12.0)))


@pytest.fixture(scope="module")
def pool():
    rng = np.random.default_rng(7)
    return [s for side in SIDES for s in find_stances(side, CAMERA, 40, rng)]


def frames(q):
    model = nao_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return lambda name: data.oMf[model.getFrameId(name)]


def of_board(across):
    """Points (n, 3) m of the board's plane in the sole's frame, `across` times as large as the board."""
    x, y = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(-1, 1, 13))
    return np.stack([0.17 + across * 0.0625 * x, across * 0.0875 * y, 0.0 * x], axis=-1).reshape(-1, 3)


def test_every_joint_is_inside_its_limits_and_the_hips_turn_together(pool):
    limits = {
        j.get("name"): [float(j.find("limit").get(key)) for key in ("lower", "upper")]
        for j in ET.parse(data_file("urdf/nao/nao.urdf")).getroot().iter("joint")
        if j.get("type") == "revolute"
    }
    for stance in pool:
        other = "R" if stance.side == "L" else "L"
        values = [(stance.side + j, v) for j, v in zip(LEG, stance.leg, strict=True)]
        values += [(other + j, v) for j, v in zip(LEG, stance.other, strict=True)]
        values += [(j, v) for head in stance.heads for j, v in zip(HEAD, head, strict=True)]
        assert all(limits[name][0] <= value <= limits[name][1] for name, value in values)
        assert stance.leg[0] == stance.other[0]


def test_the_whole_board_is_in_every_image(pool):
    for stance in pool:
        assert len({tuple(h) for h in stance.heads}) == 3
        for head in stance.heads:
            frame = frames(stance.posture(head))
            seen = frame("lower_camera").actInv(frame(f"{stance.side}_sole"))
            x, y, z = (of_board(1.0) @ seen.rotation.T + seen.translation).T
            u, v = 324.0 - 562.5 * y / x, 189.0 - 562.5 * z / x  # eq. 1
            assert x.min() > 0.0
            assert min(u.min(), v.min()) >= MARGIN_PX - 1e-6
            assert u.max() <= 639.0 - MARGIN_PX + 1e-6
            assert v.max() <= 479.0 - MARGIN_PX + 1e-6
            towards = frame("lower_camera").translation - frame(f"{stance.side}_sole").act(
                np.array([0.17, 0.0, 0.0])
            )
            assert frame(f"{stance.side}_sole").rotation[:, 2] @ towards > 0.0  # the printed side


def test_panels_stay_clear_of_floor_torso_and_each_other(pool):
    for stance in pool:
        frame = frames(stance.posture(stance.heads[0]))
        soles = {side: frame(f"{side}_sole") for side in SIDES}
        for side, other in (("L", "R"), ("R", "L")):
            points = of_board(1.0) @ soles[side].rotation.T + soles[side].translation
            assert points[:, 0].min() > -0.085
            inside = (np.abs(points - [0.0, 0.0, 0.055]) < [0.065, 0.08, 0.07]).all(axis=1)
            assert not inside.any()
            there = (points - soles[other].translation) @ soles[other].rotation
            through = (np.abs(there - [0.17, 0.0, 0.0]) < [0.0625, 0.0875, 0.003]).all(axis=1)
            assert not through.any()


def test_what_touches_and_what_hides_is_known():
    bodies, still = nao_bodies(), np.zeros(6)
    assert set(bodies.touching(bodies.posture(still, still, np.zeros(2)))) == {"L panel", "R panel"}
    assert bodies.touching(resting_posture()) is None
    curled = np.radians([0.0, 0.0, -85.0, 110.0, 0.0, 0.0])
    apart = np.radians([0.0, -30.0, 0.0, 0.0, 0.0, 0.0])
    assert bodies.touching(bodies.posture(curled, apart, np.zeros(2))) is not None
    q = resting_posture()
    sole = frames(q)("L_sole")
    board = of_board(1.0)[[0, 8, -9, -1]] + [0.0, 0.0, 5e-3]
    assert not bodies.hidden(q, board @ sole.rotation.T + sole.translation)
    heel = np.array([[x, y, 0.0] for x in (-0.05, -0.02) for y in (-0.03, 0.03)])  # below the foot
    assert bodies.hidden(q, heel @ sole.rotation.T + sole.translation)


def test_stances_are_reached_from_rest_and_left_in_order(pool):
    plan = random_stances(pool, 6, SENSING, PAPER, np.random.default_rng(1))
    assert sorted(s.side for s in plan.stances) == ["L"] * 6 + ["R"] * 6
    assert all(collision_free_motion(resting_posture(), s.posture(s.heads[0])) for s in pool)
    sides = [s.side for s in plan.stances]
    assert sum(a != b for a, b in pairwise(sides)) == 1


def test_a_way_through_the_other_panel_is_not_free():
    def pitched(left, right):
        legs = (np.radians([0.0, 0.0, pitch, 0.0, 0.0, 0.0]) for pitch in (left, right))
        return nao_bodies().posture(*legs, np.zeros(2))

    a, between, b = pitched(-80.0, -40.0), pitched(-40.0, -40.0), pitched(0.0, -40.0)
    assert nao_bodies().touching(a) is None
    assert nao_bodies().touching(b) is None
    assert set(nao_bodies().touching(between)) == {"L panel", "R panel"}
    assert not collision_free_motion(a, b)


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


def test_stances_near_one_are_near_it(pool):
    near = near_stances(pool[0], CAMERA, 200, np.radians(4.0), np.random.default_rng(2))
    assert near
    assert all(np.abs(s.leg - pool[0].leg).max() < np.radians(20.0) for s in near)


def test_what_cannot_be_planned_is_told(pool):
    with pytest.raises(InputError, match="side = 'left': must be L or R"):
        find_stances("left", CAMERA, 1, np.random.default_rng(0))
    with pytest.raises(ImpossibleError, match="50 stances of each leg are needed, but the pool has 40"):
        plan_stances(pool, 50, SENSING, PAPER)
    with pytest.raises(ImpossibleError, match="only 0 of 1 stances of leg L"):
        find_stances("L", CAMERA, 1, np.random.default_rng(0), margin_px=235.0)
