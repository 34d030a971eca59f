"""Bodies of the NAO: what touches, what hides, and ways that are free."""

import numpy as np
import pytest
from nao_paper_bench.collision import nao_bodies
from nao_paper_bench.stance_pool import (
    collision_free_motion,
    resting_posture,
)

from calib.nao.chain import SIDES
from recorded.nao_scenes import frames, of_board

pytestmark = pytest.mark.xdist_group("stances")  # one process finds the pool


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


def test_a_way_through_the_other_panel_is_not_free():
    def pitched(left, right):
        legs = (np.radians([0.0, 0.0, pitch, 0.0, 0.0, 0.0]) for pitch in (left, right))
        return nao_bodies().posture(*legs, np.zeros(2))

    a, between, b = pitched(-80.0, -40.0), pitched(-40.0, -40.0), pitched(0.0, -40.0)
    assert nao_bodies().touching(a) is None
    assert nao_bodies().touching(b) is None
    assert set(nao_bodies().touching(between)) == {"L panel", "R panel"}
    assert not collision_free_motion(a, b)
