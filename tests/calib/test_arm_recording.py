"""Recordings of an arm before a camera: what breaks the format is named, what is no measurement is not read."""

import json

import numpy as np
import pytest

from arm.errors import FileInputError
from arm_sets import LENS, NOMINAL, TARGETS, draw_truth, recorded, wide
from calib.arm_recording import read_arm_recording
from calib.hand_eye import calibrate_hand_eye


def content(count=12, seed=1):
    rng = np.random.default_rng(seed)
    truth = draw_truth(rng)
    r = recorded(truth, wide(truth, TARGETS["marker"], count, rng), "marker", rng)
    return {
        "kind": "eye_to_hand_fixed_camera",
        "seed": 1,
        "camera": {
            "K_px": LENS.K.tolist(),
            "distortion_k1k2p1p2k3": LENS.distortion.tolist(),
            "size_px": [1920, 1200],
        },
        "dh": {
            "d_m": NOMINAL.d.tolist(),
            "a_m": NOMINAL.a.tolist(),
            "alpha_rad": NOMINAL.alpha.tolist(),
            "theta_offset_rad": NOMINAL.theta_offset.tolist(),
        },
        "target": {"kind": "marker", "points_m": r.points.tolist()},
        "noise": {"corner_sigma_px": 0.3},
        "poses": [
            {"joints_rad": q.tolist(), "corners_px": c.tolist()}
            for q, c in zip(r.joints, r.pixels, strict=True)
        ],
        "truth": {"T_base_camera": truth.T_base_camera.tolist(), "joint_offsets_rad": truth.offsets.tolist()},
    }


def read(tmp_path, value):
    path = tmp_path / "poses.json"
    path.write_text(json.dumps(value))
    return read_arm_recording(path)


def test_a_recording_is_read(tmp_path):
    value = content()
    value["poses"][2]["joints_rad"][5] = 7.0  # outside any limit: it is a recording
    r = read(tmp_path, value)
    assert r.joints.shape == (12, 6)
    assert r.joints[2, 5] == 7.0
    assert r.pixels.shape == (12, 4, 2)
    assert r.kind == "marker"
    assert r.dh.d.tolist() == NOMINAL.d.tolist()
    assert r.dh.theta_offset.tolist() == NOMINAL.theta_offset.tolist()
    assert r.camera.K.tolist() == LENS.K.tolist()
    assert not r.pixels.flags.writeable


def test_corners_that_were_not_seen_are_null(tmp_path):
    value = content()
    value["target"]["points_m"].append([0.0, 0.0, 0.0])
    for pose in value["poses"]:
        pose["corners_px"].append([None, None])
    value["poses"][0]["corners_px"][4] = [5.0, None]
    assert np.isnan(read(tmp_path, value).pixels[:, 4]).all()


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (lambda v: v.pop("dh"), "dh: is missing"),
        (lambda v: v["dh"].pop("alpha_rad"), "dh.alpha_rad: is missing"),
        (lambda v: v["dh"]["a_m"].pop(), "dh.a_m: must be 6 finite numbers"),
        (lambda v: v["target"]["points_m"].pop(), "target.points_m: must be 4 points at least"),
        (lambda v: v["target"]["points_m"][0].pop(), "target.points_m: must be n x 3 finite numbers"),
        (lambda v: v.update(poses=[]), "poses: must be one pose at least"),
        (lambda v: v["poses"][3].pop("joints_rad"), "poses[3].joints_rad: is missing"),
        (lambda v: v["poses"][3]["joints_rad"].pop(), "poses[3].joints_rad: must be 6 finite numbers"),
        (
            lambda v: v["poses"][3]["corners_px"].pop(),
            "poses[3].corners_px: must be 4 x 2 finite numbers, or null",
        ),
        (
            lambda v: v["poses"][3]["corners_px"].__setitem__(0, [None, None]),
            "poses[3].corners_px: must hold 4 corners at least that are not null",
        ),
        (lambda v: v["camera"].pop("K_px"), "K_px"),
        (lambda v: v["camera"]["distortion_k1k2p1p2k3"].pop(), "distortion_k1k2p1p2k3"),
    ],
)
def test_what_breaks_the_format_is_named(tmp_path, break_it, said):
    value = content()
    break_it(value)
    with pytest.raises(FileInputError) as caught:
        read(tmp_path, value)
    assert said in str(caught.value)
    assert "poses.json" in str(caught.value)


def test_truth_and_noise_are_never_read(tmp_path):
    value = content()
    whole = calibrate_hand_eye(read(tmp_path, value))
    value.pop("truth")
    value["noise"] = "none of your business"
    bare = calibrate_hand_eye(read(tmp_path, value))
    assert bare.T_base_camera.tobytes() == whole.T_base_camera.tobytes()
    assert bare.chain.covariance.tobytes() == whole.chain.covariance.tobytes()
    assert bare.chain.reasons == whole.chain.reasons
