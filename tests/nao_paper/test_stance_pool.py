"""Stances that may be taken: within limits, with the whole board in every image."""

import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from nao_paper_bench.stance_design import random_stances
from nao_paper_bench.stance_pool import (
    MARGIN_PX,
    collision_free_motion,
    near_stances,
    resting_posture,
)

from arm.io.storage import data_file
from calib.nao.chain import HEAD, LEG
from recorded.nao_scenes import CAMERA, PAPER, SENSING, frames, of_board

pytestmark = pytest.mark.xdist_group("stances")  # one process finds the pool


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


def test_stances_are_reached_from_rest_and_left_in_order(pool):
    plan = random_stances(pool, 6, SENSING, PAPER, np.random.default_rng(1))
    assert sorted(s.side for s in plan.stances) == ["L"] * 6 + ["R"] * 6
    assert all(collision_free_motion(resting_posture(), s.posture(s.heads[0])) for s in pool)
    sides = [s.side for s in plan.stances]
    assert sum(a != b for a, b in pairwise(sides)) == 1


def test_stances_near_one_are_near_it(pool):
    near = near_stances(pool[0], CAMERA, 200, np.radians(4.0), np.random.default_rng(2))
    assert near
    assert all(np.abs(s.leg - pool[0].leg).max() < np.radians(20.0) for s in near)
