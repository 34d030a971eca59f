"""Kinematic calibration of the NAO from recordings: its file, the model that the images ask for, the verdict."""

import json

import numpy as np
import pytest

from arm.errors import FileInputError
from calib.kinematic import HEAD, PLAY, SPRINGS, calibrate_nao
from calib.nao import LEG_JOINTS, NaoUnknowns
from calib.nao_recording import read_nao_recording
from nao_recordings import as_json, nao_recording

PAPER = NaoUnknowns()


def read(tmp_path, value):
    path = tmp_path / "nao.json"
    path.write_text(json.dumps(value))
    return read_nao_recording(path)


def joints_deg(c, x, unknowns):
    places = [c.names.index(f"{j}_deg") for j in LEG_JOINTS]
    true = [unknowns.names.index(f"{j}_deg") for j in LEG_JOINTS]
    return float(np.degrees(np.sqrt(np.mean((c.fit.unknowns[places] - x[true]) ** 2))))


def needed(c):
    return {trial.part for trial in c.trials if trial.needed}


def test_a_plain_robot_gets_the_papers_model():
    recording, x = nao_recording(1, PAPER)
    c = calibrate_nao(recording)
    assert c.accepted, c.reasons
    assert needed(c) == set()
    assert joints_deg(c, x, PAPER) < 0.06
    assert c.fit.chi2_dof == pytest.approx(1.0, abs=0.1)


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


def test_springs_are_noticed():
    soft = NaoUnknowns(springs=True)
    recording, x = nao_recording(3, soft, 8)
    c = calibrate_nao(recording)
    assert SPRINGS in needed(c)
    assert PLAY not in needed(c)
    assert c.fit.chi2_dof == pytest.approx(1.0, abs=0.1)
    assert joints_deg(c, x, soft) < 0.15


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


def test_a_recording_is_read_as_it_was_written(tmp_path):
    recording, _ = nao_recording(6, PAPER, 2)
    value = as_json(recording)
    value["images"][1]["vertices_px"][3] = [None, None]
    back = read(tmp_path, value)
    assert back.leg == pytest.approx(recording.leg, abs=1e-12)
    assert back.head == pytest.approx(recording.head, abs=1e-12)
    assert back.side.tolist() == recording.side.tolist()
    assert np.isnan(back.pixels[1, 3]).all()
    assert np.isfinite(back.pixels).sum() == back.pixels.size - 2


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (lambda v: v["camera"].pop("focal_px"), "camera.focal_px: is missing"),
        (lambda v: v["camera"].update(focal_px=-3), "camera.focal_px = -3: must be above 0 px"),
        (lambda v: v["camera"].update(size_px=[0, 480]), "camera.size_px: must be width and height in px"),
        (lambda v: v["board"].update(vertices_sole_m=[[0, 0, 0]] * 3), "must be 4 vertices at least"),
        (lambda v: v.pop("gravity_m_s2"), "gravity_m_s2: is missing"),
        (lambda v: v.update(images=[]), "images: must be one image at least"),
        (lambda v: v["images"][2].update(side="left"), "images[2].side = 'left': must be one of L, R"),
        (lambda v: v["images"][2].update(stance=1.5), "images[2].stance = 1.5: must be a whole number"),
        (lambda v: v["images"][2].update(leg_encoder_deg=[1, 2]), "images[2].leg_encoder_deg: must be 6"),
        (lambda v: v["images"][2]["vertices_px"].pop(), "images[2].vertices_px: must be 24 x 2"),
        (
            lambda v: v["images"][2].update(vertices_px=[[1, 2]] * 3 + [[None, None]] * 21),
            "images[2].vertices_px: must hold 4 vertices at least",
        ),
    ],
)
def test_what_breaks_the_format_is_named(tmp_path, break_it, said):
    value = as_json(nao_recording(6, PAPER, 1)[0])
    break_it(value)
    with pytest.raises(FileInputError) as caught:
        read(tmp_path, value)
    assert said in str(caught.value)
    assert "nao.json" in str(caught.value)


def test_truth_and_noise_are_never_read(tmp_path):
    value = as_json(nao_recording(7, PAPER, 2)[0])
    whole = read(tmp_path, value)
    value.pop("truth")
    value["noise"] = None
    bare = read(tmp_path, value)
    for name in ("board", "gravity", "side", "stance", "leg", "head", "pixels"):
        assert getattr(bare, name).tobytes() == getattr(whole, name).tobytes()
    assert bare.camera.digest == whole.camera.digest
