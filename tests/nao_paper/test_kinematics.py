"""The NAO's kinematics, compared with Pinocchio, and errors of poses."""

import numpy as np
import pinocchio as pin
import pytest
from nao_paper_bench.kinematics import STANDING, NaoKinematics, pose_errors

from arm.se3 import rot_x, rot_y, rot_z
from calib.nao.chain import (
    HEAD,
    LEG,
    SIDES,
    NaoUnknowns,
    gravity_torques,
    nao_model,
)
from recorded.nao_scenes import (
    ALL,
    PAPER,
    TABLE_2,
    bent_legs,
    truth,
)

D = np.pi / 180.0


def test_commands_meet_what_is_wanted():
    """The compensation of section 2.2: offsets come off commands, because they add to readings (eq. 2)."""
    wanted = np.radians([[-5.0, 3.0, -30.0, 50.0, -25.0, 2.0]])
    rigid = NaoKinematics(PAPER, TABLE_2 * PAPER.si())
    sent = rigid.commands("L", wanted, STANDING)
    assert sent - wanted == pytest.approx(-TABLE_2[None, 3:9] * D, abs=1e-9)
    soft = NaoKinematics(ALL, truth(ALL, np.random.default_rng(1)))
    assert soft.angles("R", soft.commands("R", wanted, STANDING), STANDING) == pytest.approx(wanted, abs=1e-6)


def test_camera_and_sole_are_where_pinocchio_has_them():
    x = truth(NaoUnknowns(head=True), np.random.default_rng(0))
    nao = NaoKinematics(NaoUnknowns(head=True), x)
    model = nao_model()
    data = model.createData()
    leg, head = np.radians([[-5.0, 3.0, -30.0, 50.0, -25.0, 2.0]]), np.radians([[20.0, -10.0]])
    q = np.zeros(model.nq)
    q[[model.joints[model.getJointId(f"R{j}")].idx_q for j in LEG]] = leg[0] + x[9:15]
    q[[model.joints[model.getJointId(j)].idx_q for j in HEAD]] = head[0] + np.radians([0.5, -0.4])
    pin.framesForwardKinematics(model, data, q)
    sole = data.oMf[model.getFrameId("R_sole")].homogeneous
    camera = data.oMf[model.getFrameId("lower_camera")].homogeneous.copy()
    camera[:3, :3] = camera[:3, :3] @ rot_y(x[1]) @ rot_x(x[2]) @ rot_z(x[0])
    camera[:3, :3] = camera[:3, :3] @ [[0, 0, 1], [-1, 0, 0], [0, -1, 0]]
    assert nao.T_torso_sole("R", leg, STANDING)[0] == pytest.approx(sole, abs=1e-9)
    seen = nao.T_camera_sole("R", leg, head, STANDING)[0]
    assert seen == pytest.approx(np.linalg.inv(camera) @ sole, abs=1e-9)
    mounted = nao.T_camera_board("R", leg, head, STANDING)[0]
    mount = np.eye(4)
    mount[:3, :3] = rot_z(x[18])
    mount[:3, 3] = mount[:3, :3] @ [x[19], x[20], 0.0]
    assert mounted == pytest.approx(seen @ mount, abs=1e-9)


def test_pose_errors_are_in_metres_and_radians():
    a, b = np.tile(np.eye(4), (2, 1, 1)), np.tile(np.eye(4), (2, 1, 1))
    b[1, :3, 3] = [0.003, 0.0, 0.004]
    b[1, :3, :3] = rot_x(0.02)
    e = pose_errors(a, b)
    assert (e.rms, e.most, e.rotation_rms) == pytest.approx((0.005 / 2**0.5, 0.005, 0.02 / 2**0.5))


@pytest.mark.parametrize("hard", [False, True])
def test_angles_are_those_of_the_paper_with_springs_and_play(hard):
    x = truth(ALL, np.random.default_rng(8))
    legs = np.random.default_rng(9).uniform(-0.6, 0.6, (5, 6))
    for side in SIDES:
        told = NaoKinematics(ALL, x, hard, sure=True).angles(side, legs, STANDING)
        assert told == pytest.approx(bent_legs(side, legs, x, STANDING, hard), abs=1e-6)


def test_unsure_torques_lie_between_the_sides():
    x = truth(ALL, np.random.default_rng(8))
    legs = np.random.default_rng(9).uniform(-0.6, 0.6, (200, 6))
    sure, unsure = (NaoKinematics(ALL, x, True, s).angles("L", legs, STANDING) for s in (True, False))
    apart = np.abs(sure - unsure)
    half = x[[ALL.names.index(f"L{j}_backlash_half_deg") for j in LEG]]
    assert (apart <= half + 1e-12).all()
    far = np.abs(gravity_torques("L", legs, STANDING)) > 1.0
    assert apart[far].max() < 1e-3
    assert apart.max() > 0.5 * half.min()
