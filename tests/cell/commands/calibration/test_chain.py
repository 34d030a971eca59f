"""`a465 calibrate hand-eye` and `kinematic` on recordings: what they print, write and refuse."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.calibration_file import read_arm_calibration
from arm.errors import InputError
from arm.se3 import angle_between, frozen
from calib.chain.result import ChainCalibration, ChainLimits
from calib.chain.self_test import SelfTest
from calib.hand_eye.calibrate import HAND_EYE_LIMITS, HandEye
from calib.hand_eye.next_poses import NextPose
from calib.nao.calibrate import NAO_LIMITS
from calib.nao.chain import NaoUnknowns
from calib.recordings.arm import ArmRecording, recording_json
from cell.commands.calibration import chain as calibratechain
from cell.commands.calibration.chain import ChainOptions, hand_eye_step, kinematic_step, solve_hand_eye
from recorded.arm_sets import LENS, NOMINAL, TARGETS, Truth, recorded, wide
from recorded.faults import larger
from recorded.found_chains import MORE, nao_named, refused
from recorded.nao import as_json, nao_recording
from typed.command_line import a465, replace_in
from typed.heard import Heard


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


@pytest.mark.slow
def test_truth_and_noise_of_a_file_are_never_read(recording: Path, tmp_path: Path) -> None:
    value = json.loads(recording.read_text())
    value["poses"] = value["poses"][:10]
    results = []
    for name in ("whole.json", "stripped.json"):
        (tmp_path / name).write_text(json.dumps(value))
        results.append(hand_eye_step(tmp_path / name, ChainOptions(), Heard()))
        value.pop("truth", None), value.pop("noise", None)
    for result in results:
        result.pop("solve_s")
    assert results[0] == results[1]


@pytest.mark.slow
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
def test_a_wrong_recording_is_told_by_its_key(
    recording: Path, tmp_path: Path, key: str, value: object, words: str
) -> None:
    content = json.loads(recording.read_text()) | {key: value}
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    with pytest.raises(InputError) as told:
        hand_eye_step(tmp_path / "wrong.json", ChainOptions(tmp_path / "c.toml"), Heard())
    assert "wrong.json" in str(told.value)
    assert words in str(told.value)
    assert not (tmp_path / "c.toml").exists()


def test_a_wrong_recording_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "wrong.json").write_text('{"dh": {"d_m": [0.3]}}')
    _, told = a465("calibrate", "hand-eye", tmp_path / "wrong.json", "-o", tmp_path / "c.toml", code=2)
    (line,) = [x for x in told.splitlines() if x.startswith("a465:")]
    assert "wrong.json" in line
    assert not (tmp_path / "c.toml").exists()


@pytest.mark.slow
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


@dataclass
class Asked:
    """What a calibration was asked for, in place of which one that was made before is given."""

    recording: object
    limits: ChainLimits
    step: float | None


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, found: HandEye) -> list[Asked]:
    seen: list[Asked] = []

    def arm(recording: ArmRecording, limits: ChainLimits, step: float | None, _: object) -> HandEye:
        seen.append(Asked(recording, limits, step))
        return found

    def nao(recording: object, limits: ChainLimits, step: float | None = None) -> ChainCalibration:
        seen.append(Asked(recording, limits, step))
        return nao_named(found.chain)[0]

    monkeypatch.setattr(calibratechain, "calibrate_hand_eye", arm)
    monkeypatch.setattr(calibratechain, "calibrate_nao", nao)
    monkeypatch.setattr(calibratechain, "next_poses", lambda *_, **__: MORE)
    monkeypatch.setattr(calibratechain, "self_test", lambda c: SelfTest(1.02, (0.7, 1.3), 3.1))
    return seen


@pytest.fixture
def nao_data(tmp_path: Path) -> Path:
    path = tmp_path / "nao.json"
    value = as_json(nao_recording(3, NaoUnknowns(), stances=10)[0])
    left, right = ([image for image in value["images"] if image["side"] == side] for side in "LR")
    value["images"] = [image for pair in zip(left, right, strict=True) for image in pair]
    path.write_text(json.dumps(value))
    return path


def test_a_calibration_file_has_all_that_a_cell_needs(
    found: HandEye, asked: list[Asked], data: Path, tmp_path: Path
) -> None:
    heard = Heard()
    result = hand_eye_step(data, ChainOptions(tmp_path / "c.toml", None, 0.7, 0.5), heard)
    (ask,) = asked
    limit = pytest.approx(0.7e-3)
    assert ask.limits == replace(HAND_EYE_LIMITS, held_out=limit, sideways=limit, height=limit)
    assert ask.step == pytest.approx(np.radians(0.5))
    assert isinstance(ask.recording, ArmRecording)
    assert np.array_equal(ask.recording.pixels, found.recording.pixels)
    written = read_arm_calibration(tmp_path / "c.toml")
    assert result["id"] == written.id
    assert np.array_equal(written.T_base_camera, found.T_base_camera)
    assert np.array_equal(written.joint_offsets, found.joint_offsets)
    assert written.links.to_json() == [values.tolist() for values in found.link_errors]
    assert written.unit == "crs97"
    assert written.lens == LENS.lens_digest
    assert written.dh == NOMINAL.digest
    c = found.chain
    assert dict(written.made) == {
        "poses": 28,
        "target": "charuco",
        "held_out_px": pytest.approx(c.held_out.px, abs=1e-4),
        "held_out_mm": pytest.approx(1e3 * c.held_out.metres, abs=1e-4),
        "chi2_dof": pytest.approx(c.fit.chi2_dof, abs=1e-4),
        "camera_std_mm": pytest.approx(1e3 * np.linalg.norm(found.camera_sigma[0]), abs=1e-4),
        "tool_sideways_mm": round(1e3 * found.tool.sideways, 4),
        "tool_height_mm": round(1e3 * found.tool.height, 4),
        "self_test": "passed",
        "self_test_nees_dof": 1.02,
        "self_test_limits": [0.7, 1.3],
    }
    assert result["next_poses"][0]["gain"] == 0.25
    assert result["self_test"] == {
        "nees_dof": 1.02,
        "limits": [0.7, 1.3],
        "worst_sigmas": 3.1,
        "passed": True,
    }
    tested = "squared errors are 1.02 times the predicted ones (by chance: 0.70 to 1.30), as predicted"
    assert tested in heard.all
    assert f"Self-test:</b> on 4 synthetic twins {tested}" in (tmp_path / "c.html").read_text()
    assert any(line.endswith("25 %") for line in heard.told)
    assert (tmp_path / "c.html").exists()
    assert "was written" not in heard.all
    heard = Heard()
    assert hand_eye_step(data, ChainOptions(tmp_path / "c.toml"), heard)["id"] == result["id"]
    assert any(line.startswith("written:") for line in heard.told), "over the one of before"


UNNAMED = "so no cell accepts this calibration"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {},
            "to use it, add to the cell file of the crs97, with the path relative to its folder; in the same folder: "
            'calibration = "c.toml"',
        ),
        (
            {"unit": ""},
            f"the recording is of no unit, {UNNAMED}: add the name of the arm's unit (crs93, crs97, or",
        ),
        ({"unit": "mine"}, "to use it, add to the cell file of the mine"),
        (
            {"dh": replace(NOMINAL, d=frozen(NOMINAL.d + 0.1))},
            f"are not the parameters of the A465, {UNNAMED}",
        ),
    ],
)
def test_what_is_to_be_done_with_a_calibration_is_told_as_it_is(
    found: HandEye, asked: list[Asked], tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    data = tmp_path / "arm.json"
    data.write_text(json.dumps(recording_json(replace(found.recording, **changed))))
    heard = Heard()
    hand_eye_step(data, ChainOptions(tmp_path / "out" / "c.toml"), heard)
    assert words in heard.told[-1]
    assert ("to use it" in heard.all) == words.startswith("to use it")


def test_a_recording_of_another_unit_than_the_cells_is_refused(recording: Path, scenes: Path) -> None:
    cell = scenes / "cell.toml"
    replace_in(cell, 'unit = "crs93"', 'unit = "crs97"')
    other = scenes / "recorded.json"
    other.write_text(json.dumps({**json.loads(recording.read_text()), "unit": "crs93"}))
    _, told = a465("calibrate", "hand-eye", other, "--cell", cell, "-o", scenes / "c.toml", code=2)
    rule = f"must be 'crs97', the unit of {cell} (record that arm, or give the cell of the crs93)"
    assert f"unit = 'crs93': {rule}" in told
    assert not (scenes / "c.toml").exists()


def test_a_cell_that_is_known_gets_the_name_from_where_it_is(
    found: HandEye, asked: list[Asked], data: Path, tmp_path: Path
) -> None:
    cell, output = tmp_path / "cells" / "cell.toml", tmp_path / "out" / "c.toml"
    cell.parent.mkdir()
    heard = Heard()
    solve_hand_eye(data, found.recording, ChainOptions(output, cell=cell), heard)
    assert heard.told[-1] == f'to use it, add to {cell}: calibration = "../out/c.toml"'


def test_without_a_file_to_write_none_is_written_and_that_is_told(
    asked: list[Asked], data: Path, tmp_path: Path
) -> None:
    heard = Heard()
    result = hand_eye_step(data, ChainOptions(None, tmp_path / "r.html"), heard)
    assert (asked[0].limits, asked[0].step) == (HAND_EYE_LIMITS, None)
    assert "no calibration file was written; give -o FILE to write one" in heard.told
    assert "id" not in result
    assert {path.name for path in tmp_path.iterdir()} == {"arm.json", "r.html"}


def test_what_is_refused_is_reported_and_neither_tested_nor_written(
    found: HandEye, asked: list[Asked], data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibratechain, "calibrate_hand_eye", lambda *_: refused(found))
    result = hand_eye_step(data, ChainOptions(tmp_path / "c.toml", tmp_path / "r.html"), Heard())
    assert result["verdict"] == "refused"
    assert "self_test" not in result
    assert {path.name for path in tmp_path.iterdir()} == {"arm.json", "r.html"}
    assert "Self-test:</b> not run" in (tmp_path / "r.html").read_text()
    heard = Heard()
    hand_eye_step(data, ChainOptions(), heard)
    assert "no calibration file" not in heard.all, "as if -o FILE would have written one"


def test_more_poses_are_advised_of_those_where_the_arm_may_go(
    found: HandEye, asked: list[Asked], data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pools = []

    def noted(_: HandEye, pool: np.ndarray | None = None) -> list[NextPose]:
        pools.append(pool)
        return MORE

    monkeypatch.setattr(calibratechain, "next_poses", noted)
    pool = np.zeros((3, 6))
    for given in (None, pool):
        solve_hand_eye(data, found.recording, ChainOptions(), Heard(), pool=given)
    assert pools == [None, pool]


FAILED = SelfTest(2.0, (0.7, 1.3), 9.0)


def test_a_self_test_that_fails_refuses(
    asked: list[Asked], data: Path, nao_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibratechain, "self_test", lambda c: FAILED)
    for verb, read, output in (("hand-eye", data, "c.toml"), ("kinematic", nao_data, "c.json")):
        said, told = a465("calibrate", verb, read, "-o", tmp_path / output, "--json", code=5)
        result = json.loads(said)
        assert (result["verdict"], result["self_test"]["passed"]) == ("refused", False)
        (reason,) = result["reasons"]
        assert "the self-test fails" in reason
        assert "2.00 times the predicted ones (by chance: 0.70 to 1.30), NOT as predicted" in reason
        assert f"refused: {reason}; {tmp_path / output} was not written" in told
        assert not (tmp_path / output).exists()
        page = (tmp_path / "c.html").read_text()
        assert "refused" in page
        assert page.count("NOT as predicted") == 2


def test_the_result_of_a_nao_is_written_as_it_is_told(
    found: HandEye, asked: list[Asked], nao_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = Heard()
    result = kinematic_step(nao_data, ChainOptions(tmp_path / "found.json", None, 3.0, 0.1), heard)
    (ask,) = asked
    # images 4 and 11 of the left leg, of which every other image of the file is
    assert result["wrong_images"] == [[8, 22]]
    assert "left out:    8, 22 (images count from 0)" in heard.told
    assert "left out: 8, 22 (images count from 0)" in (tmp_path / "found.html").read_text()
    assert ask.limits == replace(NAO_LIMITS, held_out=pytest.approx(3e-3))
    assert ask.step == pytest.approx(np.radians(0.1))
    assert json.loads((tmp_path / "found.json").read_text()) == result
    assert result["self_test"]["passed"] is True
    assert (tmp_path / "found.html").exists()
    kinematic_step(nao_data, ChainOptions(), Heard())
    assert (asked[1].limits, asked[1].step) == (NAO_LIMITS, None)
    bad = replace(nao_named(found.chain)[0], reasons=("too far off",))
    monkeypatch.setattr(calibratechain, "calibrate_nao", lambda *_: bad)
    assert "self_test" not in kinematic_step(nao_data, ChainOptions(tmp_path / "other.json"), Heard())
    assert not (tmp_path / "other.json").exists()
    assert (tmp_path / "other.html").exists()


@pytest.mark.parametrize("deg", [0.0, 5.0])
def test_exact_and_very_coarse_encoders_may_be_stated(asked: list[Asked], data: Path, deg: float) -> None:
    hand_eye_step(data, ChainOptions(None, None, None, deg), Heard())
    assert asked[0].step == pytest.approx(np.radians(deg))
