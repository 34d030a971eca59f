"""`a465 calibrate hand-eye` and `kinematic` on recordings: what they print, write and refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.armcalibration import read_arm_calibration
from arm.se3 import angle_between
from arm_sets import TARGETS, Truth, draw_truth, recorded, wide
from calib.nao import NaoUnknowns
from cell.collecting import recording_json
from command_line import a465
from nao_recordings import as_json, nao_recording
from recorded_faults import larger


@pytest.fixture(scope="module")
def truth() -> Truth:
    return draw_truth(np.random.default_rng(8))


@pytest.fixture(scope="module")
def recording(truth: Truth, tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(9)
    joints = wide(truth, TARGETS["charuco"], 20, rng)
    value = recording_json(recorded(truth, joints, "charuco", rng))
    value["noise"], value["truth"] = {"corner_sigma_px": 7.0}, {"T_base_camera": np.eye(4).tolist()}
    path = tmp_path_factory.mktemp("recording") / "recorded.json"
    path.write_text(json.dumps(value))
    return path


def test_hand_eye_prints_writes_and_reports(truth: Truth, recording: Path, tmp_path: Path) -> None:
    said, told = a465("calibrate", "hand-eye", recording, "-o", tmp_path / "c.toml", "--json")
    result = json.loads(said)
    T = np.array(result["T_base_camera"])
    std = result["std"]
    off = np.linalg.norm(T[:3, 3] - truth.T_base_camera[:3, 3])
    assert off < 5e-4
    assert off < 4.0 * np.linalg.norm(std["T_base_camera"]["position_m"])
    assert np.degrees(angle_between(T[:3, :3], truth.T_base_camera[:3, :3])) < 0.05
    zeros = np.array(result["joint_offsets_rad"]) - truth.offsets
    assert (np.abs(zeros) <= 5.0 * np.array(std["joint_offsets_rad"]) + 1e-12).all()
    assert np.array(result["T_gripper_target"]).shape == (4, 4)
    assert 0.2 < result["held_out_px"] < 0.4
    assert 0.0 < result["held_out_mm"] < 0.2
    assert (result["verdict"], result["reasons"]) == ("accepted", [])
    assert result["self_test"]["passed"]
    assert 0.8 < result["chi2_dof"] < 1.2
    written = read_arm_calibration(tmp_path / "c.toml")
    assert written.id == result["id"]
    assert written.T_base_camera.tolist() == result["T_base_camera"]
    page = (tmp_path / "c.html").read_text()
    assert "accepted" in page
    assert "http" not in page.replace("http-equiv", "")
    assert "camera in base" in told


def test_truth_and_noise_of_a_file_are_never_read(recording: Path, tmp_path: Path) -> None:
    value = json.loads(recording.read_text())
    del value["truth"], value["noise"]
    (tmp_path / "stripped.json").write_text(json.dumps(value))
    results = [
        json.loads(a465("calibrate", "hand-eye", path, "--json")[0])
        for path in (recording, tmp_path / "stripped.json")
    ]
    for result in results:
        result.pop("solve_s")
    assert results[0] == results[1]


def test_a_target_of_another_size_is_refused_and_nothing_is_written(truth: Truth, tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    joints = wide(truth, TARGETS["charuco"], 24, rng)
    path = tmp_path / "larger.json"
    path.write_text(json.dumps(recording_json(larger(truth, joints, "charuco", rng))))
    said, told = a465("calibrate", "hand-eye", path, "-o", tmp_path / "c.toml", "--json", code=5)
    result = json.loads(said)
    assert result["verdict"] == "refused"
    assert any("target" in reason for reason in result["reasons"])
    assert result["suspects"][0]["name"] == "target size"
    assert result["suspects"][0]["amount"] == pytest.approx(0.01, abs=0.002)
    assert not (tmp_path / "c.toml").exists()
    assert "c.toml was not written" in told
    assert "refused" in (tmp_path / "c.html").read_text()


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("dh", {"d_m": [0.3]}, "dh.a_m: is missing"),
        ("target", {"points_m": [[0, 0, 0]]}, "target.points_m"),
        ("poses", [], "poses"),
        ("camera", 3, "camera"),
    ],
)
def test_a_wrong_recording_is_told_in_one_line(
    recording: Path, tmp_path: Path, key: str, value: object, words: str
) -> None:
    content = json.loads(recording.read_text()) | {key: value}
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    _, told = a465("calibrate", "hand-eye", tmp_path / "wrong.json", "-o", tmp_path / "c.toml", code=2)
    (line,) = [x for x in told.splitlines() if x.startswith("a465:")]
    assert "wrong.json" in line
    assert words in line
    assert not (tmp_path / "c.toml").exists()


def test_the_nao_gets_its_numbers_by_the_names_of_the_data(tmp_path: Path) -> None:
    r, x = nao_recording(3, NaoUnknowns(head=True), stances=10)
    (tmp_path / "nao.json").write_text(json.dumps(as_json(r)))
    said, told = a465(
        "calibrate", "kinematic", tmp_path / "nao.json", "-o", tmp_path / "found.json", "--json"
    )
    result = json.loads(said)
    unknowns = NaoUnknowns(head=True)
    found = result["parameters"]
    assert set(found) == set(unknowns.names)
    scores = np.array(
        [
            (found[n]["value"] - t / u) / found[n]["std"]
            for n, t, u in zip(unknowns.names, x, unknowns.si(), strict=True)
        ]
    )
    assert np.abs(scores).max() < 4.5
    assert 0.4 < np.mean(scores**2) < 2.0
    pairs = [set(c["parameters"]) for c in result["correlations"]]
    assert {"CamPitch_deg", "HeadPitch_deg"} in pairs
    assert (result["verdict"], result["reasons"]) == ("accepted", [])
    assert len(result["residual_std_px"]) == 2
    assert result["iterations"] <= 8
    assert 0.9 < result["chi2_dof"] < 1.1
    assert json.loads((tmp_path / "found.json").read_text())["parameters"] == found
    assert (tmp_path / "found.html").exists()
    assert "encoders:" in told
