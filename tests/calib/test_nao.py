"""The NAO's chain and its calibration on synthetic images: Table 2 is found again, what it leaves out is noticed."""

import numpy as np
import pinocchio as pin
import pytest

from calib.chain_fit import fit_chains
from calib.nao import LEG_JOINTS, NaoUnknowns, nao_chain, nao_model
from nao_scenes import PIXEL_SIGMA, problem, sightings

PAPER, HEAD = NaoUnknowns(), NaoUnknowns(head=True)
ALL = NaoUnknowns(head=True, springs=True, play=True)


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
