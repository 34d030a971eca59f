"""Recordings of an arm before a camera: what breaks the format is named, what is no measurement is not read."""

import copy
import json

import numpy as np
import pytest

from arm.errors import FileInputError
from calib.hand_eye.calibrate import calibrate_hand_eye
from calib.recordings.arm import read_arm_recording
from recorded.arm_sets import LENS, NOMINAL, TARGETS, draw_truth, recorded, wide


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


def in_mm(table, key):
    table[key] = (1e3 * np.array(table[key])).tolist()


def in_image_sizes(pose):
    pose["corners_px"] = (np.array(pose["corners_px"]) / [1920, 1200]).tolist()


@pytest.mark.parametrize(
    ("break_it", "said"),
    [
        (lambda v: v.pop("dh"), "dh: is missing"),
        (
            lambda v: v["poses"][3].update(joints_rad=[0, -45, -90, 0, 30, 0]),
            "poses[3].joints_rad = [0, -45, -90, 0, 30, 0]: must be within 4 pi rad (are these degrees?)",
        ),
        (lambda v: v["dh"].pop("alpha_rad"), "dh.alpha_rad: is missing"),
        (lambda v: v["dh"]["a_m"].pop(), "dh.a_m: must be 6 finite numbers"),
        (lambda v: in_mm(v["target"], "points_m"), "target.points_m: must be within 10 m\n"),
        (lambda v: in_mm(v["dh"], "d_m"), "dh.d_m: must be within 10 m\n"),
        (lambda v: in_mm(v["dh"], "a_m"), "dh.a_m: must be within 10 m\n"),
        (lambda v: in_mm(v["dh"], "a_m"), ": must be within 10 m (are these mm?)"),
        (lambda v: v["target"]["points_m"].pop(), "target.points_m: must have at least 4 points"),
        (
            lambda v: v["target"].update(points_m=[[0.01 * k, 0.02 * k, 0] for k in range(4)]),
            "target.points_m: must have points that do not all lie on one line",
        ),
        (
            lambda v: v["poses"][3].update(corners_px=[[300, 200]] * 4),
            "poses[3].corners_px: must have corners that do not all lie on one line",
        ),
        (lambda v: v["target"]["points_m"][0].pop(), "target.points_m: must be rows of 3 finite numbers"),
        (lambda v: v.update(poses=[]), "poses: must have at least one pose"),
        (lambda v: v["poses"][3].pop("joints_rad"), "poses[3].joints_rad: is missing"),
        (lambda v: v["poses"][3]["joints_rad"].pop(), "poses[3].joints_rad: must be 6 finite numbers"),
        (
            lambda v: v["poses"][3]["corners_px"].pop(),
            "poses[3].corners_px: must be 4 rows of 2 finite numbers, or null",
        ),
        (
            lambda v: v["poses"][3]["corners_px"].__setitem__(0, [None, None]),
            "poses[3].corners_px: must have at least 4 corners that are not null",
        ),
        (
            lambda v: v["camera"].update(covariance=(-np.eye(9)).tolist()),
            "camera.covariance: must be a covariance: 9 rows of 9 finite numbers, symmetric, without negative",
        ),
        (
            lambda v: [in_image_sizes(pose) for pose in v["poses"]],
            "within 0.31 px (are they fractions of the image's size?)",
        ),
        (
            lambda v: v["camera"].update(size_px=[3840, 2400]),
            "it is the middle of 2145 x 1067 px: are size_px and K_px of images of one size?",
        ),
        (lambda v: v["camera"].update(size_px=[1200, 1920]), "are they swapped? [1920, 1200]"),
        (lambda v: v["camera"].pop("K_px"), "K_px"),
        (lambda v: v["camera"]["distortion_k1k2p1p2k3"].pop(), "distortion_k1k2p1p2k3"),
    ],
)
def test_what_breaks_the_format_is_named(tmp_path, break_it, said):
    value = content()
    break_it(value)
    with pytest.raises(FileInputError) as caught:
        read(tmp_path, value)
    assert said in f"{caught.value.data['key']}: {caught.value.data['rule']}\n{caught.value}"
    assert "poses.json" in str(caught.value)


@pytest.mark.parametrize(
    ("corner", "axis", "out", "within"),
    [(0, 0, -19.3, -19.2), (1, 1, -19.3, -19.2), (2, 0, 1938.3, 1938.2), (3, 1, 1218.3, 1218.2)],
)
def test_a_corner_far_outside_the_image_is_refused(tmp_path, corner, axis, out, within):
    """The image is 1920 x 1200 px: a hundredth of its longer side is 19.2 px."""
    value = content()
    value["poses"][4]["corners_px"][corner][axis] = within
    assert read(tmp_path, value).pixels[4, corner, axis] == within
    value["poses"][4]["corners_px"][corner][axis] = out
    with pytest.raises(FileInputError, match=r"poses\.json: poses\[4\]\.corners_px.*1920 x 1200") as caught:
        read(tmp_path, value)
    assert caught.value.data["key"] == f"poses[4].corners_px[{corner}][{axis}]"
    assert caught.value.data["value"] == out
    assert caught.value.data["rule"].startswith(f"must be from -19.2 to {(1938.2, 1218.2)[axis]} px")
    assert caught.value.exit_code == 2


def test_corners_whose_u_and_v_may_be_swapped_are_asked_for(tmp_path):
    value = content()
    asks = []
    for corners in (
        [[500, 1700], [500, 1500], [800, 1500], [800, 1700]],
        [[500, 1700], [1500, 500], [9, 9], [9, 99]],
    ):
        value["poses"][0]["corners_px"] = corners
        with pytest.raises(FileInputError) as caught:
            read(tmp_path, value)
        asks.append("may lie 19.2 px outside (are u and v swapped?)" in str(caught.value))
    assert asks == [True, False]


def test_a_corner_that_was_not_seen_is_nowhere(tmp_path):
    value = content()
    value["target"]["points_m"].append([0.0, 0.0, 0.0])
    for pose in value["poses"]:
        pose["corners_px"].append([None, 1e6])
    assert np.isnan(read(tmp_path, value).pixels[:, 4]).all()


def test_a_pose_that_is_there_twice_is_refused(tmp_path):
    value = content()
    value["target"]["points_m"].append([0.0, 0.0, 0.0])
    for pose in value["poses"]:
        pose["corners_px"].append([None, None])
        pose["joints_rad"][0] = 0.0
    again = copy.deepcopy(value["poses"][3])
    again["joints_rad"][0] = -0.0
    value["poses"].insert(9, again)
    with pytest.raises(FileInputError, match=r"poses\.json: poses\[9\]: repeats poses\[3\]") as caught:
        read(tmp_path, value)
    assert (caught.value.data["key"], caught.value.exit_code) == ("poses[9]", 2)


def test_a_pose_that_nearly_is_there_twice_is_refused(tmp_path):
    """No arm comes back to 1e-9 rad; noise that differs by 1e-6 px is the same noise, written otherwise."""
    value = content()
    again = copy.deepcopy(value["poses"][3])
    again["joints_rad"][2] += 1e-9
    again["corners_px"][1][0] -= 1e-6
    value["poses"].append(again)
    with pytest.raises(FileInputError, match=r"poses\[12\]: repeats poses\[3\]"):
        read(tmp_path, value)
    again["joints_rad"][2] += 1e-5
    assert len(read(tmp_path, value).joints) == 13


@pytest.mark.parametrize("same", ["joints_rad", "corners_px"])
def test_two_images_from_one_place_or_one_wrong_image_are_no_repeat(tmp_path, same):
    value = content()
    value["poses"][9][same] = value["poses"][3][same]
    assert len(read(tmp_path, value).joints) == 12


def test_a_recording_of_a_nao_is_sent_to_its_own_command(tmp_path):
    for value in ({"images": [], "board": {}}, content() | {"images": 3}):
        value.pop("poses", None)
        with pytest.raises(
            FileInputError, match=r"poses\.json: is a recording of a NAO.*a465 calibrate kinematic"
        ):
            read(tmp_path, value)
    assert len(read(tmp_path, content() | {"images": ["a.png"]}).joints) == 12


def test_truth_and_noise_are_never_read(tmp_path):
    value = content()
    whole = calibrate_hand_eye(read(tmp_path, value))
    value.pop("truth")
    value["noise"] = "none of your business"
    bare = calibrate_hand_eye(read(tmp_path, value))
    assert bare.T_base_camera.tobytes() == whole.T_base_camera.tobytes()
    assert bare.chain.covariance.tobytes() == whole.chain.covariance.tobytes()
    assert bare.chain.reasons == whole.chain.reasons
