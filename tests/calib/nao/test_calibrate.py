"""Kinematic calibration of the NAO from recordings: its file, the model that the images ask for, the verdict."""

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import InputError
from calib.nao.calibrate import BACKLASH, COMPLIANCE, HEAD, calibrate_nao
from calib.nao.chain import LEG_JOINTS, NaoUnknowns
from recorded.nao import nao_recording
from recorded.nao_scenes import PAPER


def joints_deg(c, x, unknowns):
    places = [c.names.index(f"{j}_deg") for j in LEG_JOINTS]
    true = [unknowns.names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.mean((c.fit.unknowns[places] - x[true]) ** 2))))


def needed(c):
    return {trial.part for trial in c.trials if trial.needed}


@pytest.mark.slow
def test_a_plain_robot_gets_the_papers_model():
    recording, x = nao_recording(1, PAPER)
    c = calibrate_nao(recording)
    assert c.accepted, c.reasons
    assert needed(c) == set()
    assert joints_deg(c, x, PAPER) < 0.06
    assert c.fit.chi2_dof == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_offsets_of_the_head_are_noticed():
    head = NaoUnknowns(head=True)
    recording, x = nao_recording(2, head)
    c = calibrate_nao(recording)
    assert c.accepted, c.reasons
    assert needed(c) == {HEAD}
    assert joints_deg(c, x, head) < 0.06
    off = np.degrees(c.fit.unknowns[c.names.index("HeadYaw_deg")]) - 0.5
    assert abs(off) < 0.1
    assert any("CamPitch" in a + b and "HeadPitch" in a + b for a, b, _ in c.correlations)


@pytest.mark.slow
def test_springs_are_noticed():
    soft = NaoUnknowns(compliance=True)
    recording, x = nao_recording(3, soft, 8)
    c = calibrate_nao(recording)
    assert COMPLIANCE in needed(c)
    assert BACKLASH not in needed(c)
    assert c.fit.chi2_dof == pytest.approx(1.0, abs=0.1)
    assert joints_deg(c, x, soft) < 0.15


@pytest.mark.slow
def test_gravity_the_other_way_round_is_noticed():
    recording, _ = nao_recording(3, NaoUnknowns(compliance=True), 8)
    c = calibrate_nao(replace(recording, gravity=-recording.gravity))
    assert not c.accepted
    assert any("is the sign of gravity_m_s2 right?" in reason for reason in c.reasons)


def test_an_image_that_no_pose_explains_is_named():
    recording, _ = nao_recording(6, PAPER, 4)
    lens = replace(recording.camera, K=np.array([[1e-3, 0, 324], [0, 1e-3, 189], [0, 0, 1]]))
    with pytest.raises(InputError, match="image 0: no pose of the target fits"):
        calibrate_nao(replace(recording, camera=lens))


@pytest.mark.slow
def test_exact_encoders_are_seen():
    recording, x = nao_recording(4, PAPER, 6, step=0.0)
    c = calibrate_nao(recording)
    assert (c.problem.reading_sigma == 0.0).all()
    assert joints_deg(c, x, PAPER) < 0.01
    assert c.residual_std == pytest.approx([0.0486, 0.0403], rel=0.05)


def test_one_leg_alone_is_calibrated():
    recording, _ = nao_recording(5, PAPER, 5)
    left = recording.side == 0
    part = type(recording)(
        recording.camera,
        recording.board,
        recording.gravity,
        *(getattr(recording, name)[left] for name in ("side", "stance", "leg", "head", "pixels")),
    )
    c = calibrate_nao(part)
    free = [name for name, is_free in zip(c.names, c.problem.free, strict=True) if is_free]
    assert not [name for name in free if name.startswith("R")]
    assert "LKneePitch_deg" in free
