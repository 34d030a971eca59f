"""The NAO's chain and its calibration on synthetic images: Table 2 is found again, what it leaves out is noticed."""

import numpy as np
import pinocchio as pin
import pytest

from arm.se3 import rot_x, rot_y, rot_z
from calib.chain.fit import fit_chains
from calib.nao.chain import (
    LEG_JOINTS,
    LIMBS,
    NaoUnknowns,
    gravity_gains,
    leg_chain,
    nao_chain,
    nao_model,
)
from recorded.nao_scenes import PIXEL_SIGMA, problem, sightings

PAPER, HEAD = NaoUnknowns(), NaoUnknowns(head=True)

ALL = NaoUnknowns(head=True, compliance=True, backlash=True)


def joint_rms_deg(fit, x, unknowns):
    places = [unknowns.names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.mean((fit.unknowns - x)[places] ** 2))))


def test_the_chain_is_pinocchios():
    model = nao_model()
    data = model.createData()
    rng = np.random.default_rng(1)
    for side in "LR":
        leg, head = rng.uniform(-0.6, 0.6, 6), rng.uniform(-0.4, 0.4, 2)
        T = nao_chain(side, PAPER).evaluate(np.concatenate([leg, head])[None], np.zeros(21)).T[0]
        q = np.zeros(model.nq)
        first = model.joints[model.getJointId(f"{side}HipYawPitch")].idx_q
        q[first : first + 6], q[:2] = leg, head
        pin.framesForwardKinematics(model, data, q)
        camera, sole = (data.oMf[model.getFrameId(n)] for n in ("lower_camera", f"{side}_sole"))
        forward = camera.actInv(sole).homogeneous  # x forward, y left, z up, as the paper has it
        optical = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]) @ forward[:3]
        assert T[:3] == pytest.approx(optical, abs=1e-12)


def test_table_2_is_found_from_zero_with_exact_encoders():
    found, x = sightings(2, PAPER, PAPER, step=0.0)
    fit = fit_chains(problem(found, PAPER, step=0.0))
    assert fit.iterations <= 8
    residual = np.concatenate([r.reshape(-1, 2) for r in fit.residuals]).std(axis=0)
    assert residual == pytest.approx(PIXEL_SIGMA, rel=0.02)
    assert joint_rms_deg(fit, x, PAPER) < 0.005


def test_coarse_encoders_are_weighed():
    found, x = sightings(3, PAPER, PAPER)
    fit = fit_chains(problem(found, PAPER))
    plain = fit_chains(problem(found, PAPER, step=0.0))
    assert joint_rms_deg(fit, x, PAPER) < 0.05
    assert joint_rms_deg(plain, x, PAPER) > 2.0 * joint_rms_deg(fit, x, PAPER)
    assert fit.chi2_dof == pytest.approx(1.0, abs=0.06)
    assert plain.chi2_dof > 20.0
    off = fit.unknowns - x
    assert off @ fit.information @ off / len(off) < 2.5


def test_a_head_that_is_off_is_noticed_and_found():
    found, _ = sightings(4, HEAD, PAPER)
    assert fit_chains(problem(found, PAPER)).chi2_dof > 1.1
    found, x = sightings(4, HEAD, HEAD)
    fit = fit_chains(problem(found, HEAD))
    assert fit.chi2_dof == pytest.approx(1.0, abs=0.06)
    head = np.degrees(fit.unknowns - x)[[HEAD.names.index("HeadYaw_deg"), HEAD.names.index("HeadPitch_deg")]]
    assert np.abs(head).max() < 0.1


def test_springs_and_play_are_noticed_and_found():
    found, _ = sightings(5, ALL, HEAD)
    assert fit_chains(problem(found, HEAD)).chi2_dof > 3.0
    found, x = sightings(5, ALL, ALL)
    fit = fit_chains(problem(found, ALL))
    assert fit.chi2_dof == pytest.approx(1.0, abs=0.06)
    score = (fit.unknowns - x) / np.sqrt(np.diag(fit.covariance(np.ones(len(x), dtype=bool))))
    assert np.mean(np.abs(score) < 2.0) > 0.85


def test_the_camera_turns_as_equation_3_says():
    x = np.zeros(21)
    yaw, pitch, roll = x[:3] = np.radians([3.0, -5.0, 2.0])
    still = np.zeros((1, 8))
    turned, straight = (nao_chain("L", PAPER).evaluate(still, u).T[0] for u in (x, np.zeros(21)))
    forward = np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]], dtype=float)
    R = rot_y(pitch) @ rot_x(roll) @ rot_z(yaw)
    assert turned[:3, :3] == pytest.approx(forward @ R.T @ forward.T @ straight[:3, :3], abs=1e-12)


def test_lengths_are_those_of_the_data_sheet():
    model = nao_model()
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(model.nq))
    for side, y in (("L", 0.050), ("R", -0.050)):
        sole = data.oMf[model.getFrameId(f"{side}_sole")].translation
        assert sole == pytest.approx([0.0, y, -0.085 - 0.100 - 0.1029 - 0.04519], abs=1e-9)
    camera = data.oMf[model.getFrameId("lower_camera")]
    assert camera.translation == pytest.approx([0.05071, 0.0, 0.1265 + 0.01774], abs=1e-9)
    assert camera.rotation == pytest.approx(rot_y(np.radians(39.7)), abs=1e-9)


def test_a_limb_is_longer_outwards_and_downwards():
    unknowns = NaoUnknowns(limbs=True)
    x = np.zeros(len(unknowns.names))
    longer = dict(zip(LIMBS, 1e-3 * np.array([1.0, 2.0, 4.0, 8.0, 16.0]), strict=True))
    for side, out in (("L", 1.0), ("R", -1.0)):
        x[:] = 0.0
        x[[unknowns.names.index(f"{side}{limb}_mm") for limb in LIMBS]] = list(longer.values())
        sole = leg_chain(side, unknowns).evaluate(np.zeros((1, 8)), x).T[0, :3, 3]
        assert sole == pytest.approx([0.0, out * 0.051, -0.085 - 0.100 - 0.1029 - 0.04519 - 0.030], abs=1e-9)
        bent = np.zeros((1, 8))
        bent[0, 3] = np.pi / 2.0  # the knee
        sole = leg_chain(side, unknowns).evaluate(bent, x).T[0, :3, 3]
        tibia = -(0.1029 + 0.04519 + 0.024)
        assert sole == pytest.approx([tibia, out * 0.051, -0.085 - 0.100 - 0.006], abs=1e-9)


def test_torques_are_those_of_gravity_as_it_acts():
    """Minus the derivative of the potential energy by each joint, by finite differences."""
    model = nao_model().copy()
    model.gravity.linear = np.array([-9.81, 0.0, 0.0])
    data = model.createData()
    leg = np.random.default_rng(2).uniform(-0.5, 0.5, 6)
    gains = gravity_gains("L", ALL, np.array([-9.81, 0.0, 0.0]))
    assert gains is not None
    told = gains(np.concatenate([leg, [0.0, 0.0]])[None], np.zeros(len(ALL.names)))
    first, h = model.joints[model.getJointId("LHipYawPitch")].idx_q, 1e-6

    def energy(angles):
        q = np.zeros(model.nq)
        q[first : first + 6] = angles
        return pin.computePotentialEnergy(model, data, q)

    for i, joint in enumerate(LEG_JOINTS[:6]):
        step = h * np.eye(6)[i]
        torque = -(energy(leg + step) - energy(leg - step)) / (2 * h)
        assert told[f"torque {joint}"][0] == pytest.approx(torque, abs=1e-6)
        assert told[f"backlash {joint}"][0] == pytest.approx(np.tanh(torque / 0.05), abs=1e-4)
