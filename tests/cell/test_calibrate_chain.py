"""`a465 calibrate hand-eye` and `kinematic` on recordings: what they print, write and refuse."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.armcalibration import read_arm_calibration
from arm.errors import InputError
from arm.files import data_file
from arm.se3 import angle_between, frozen
from arm_sets import LENS, NOMINAL, TARGETS, Truth, draw_truth, recorded, wide
from calib.arm_recording import ArmRecording, recording_json
from calib.chain_calibration import ChainCalibration, ChainLimits
from calib.chain_suspects import ChainSuspect
from calib.hand_eye import HAND_EYE_LIMITS, LINKS, HandEye, calibrate_hand_eye
from calib.kinematic import NAO_LIMITS
from calib.nao import NaoUnknowns
from calib.next_poses import NextPose
from calib.twin import SelfTest
from cell import calibratechain
from cell.calibratechain import Results, hand_eye_step, kinematic_step, solve_hand_eye
from cell.chainpage import chain_page
from cell.chainresult import (
    hand_eye_json,
    hand_eye_tables,
    kinematic_json,
    kinematic_tables,
    numbers,
    tell_hand_eye,
    with_std,
)
from cell.console import Console
from command_line import a465
from nao_recordings import as_json, nao_recording
from recorded_faults import larger

Step = Callable[[Path, Path | None, Path | None, float | None, float | None, Console], dict[str, Any]]


class Heard(Console):
    """A console that remembers what was said."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[str] = []

    def say(self, text: str = "") -> None:
        self.told.append(text)

    @property
    def all(self) -> str:
        return "\n".join(self.told)


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
    value["poses"] = value["poses"][:10]
    results = []
    for name in ("whole.json", "stripped.json"):
        (tmp_path / name).write_text(json.dumps(value))
        results.append(hand_eye_step(tmp_path / name, None, None, None, None, Heard()))
        value.pop("truth", None), value.pop("noise", None)
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
def test_a_wrong_recording_is_told_by_its_key(
    recording: Path, tmp_path: Path, key: str, value: object, words: str
) -> None:
    content = json.loads(recording.read_text()) | {key: value}
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    with pytest.raises(InputError) as told:
        hand_eye_step(tmp_path / "wrong.json", tmp_path / "c.toml", None, None, None, Heard())
    assert "wrong.json" in str(told.value)
    assert words in str(told.value)
    assert not (tmp_path / "c.toml").exists()


def test_a_wrong_recording_is_told_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "wrong.json").write_text('{"dh": {"d_m": [0.3]}}')
    _, told = a465("calibrate", "hand-eye", tmp_path / "wrong.json", "-o", tmp_path / "c.toml", code=2)
    (line,) = [x for x in told.splitlines() if x.startswith("a465:")]
    assert "wrong.json" in line
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


@pytest.fixture(scope="module")
def found() -> HandEye:
    """A calibration with errors of the links in it, and with things to tell that it does not have."""
    rng = np.random.default_rng(3)
    truth = draw_truth(rng, links=True)
    joints = wide(truth, TARGETS["charuco"], 30, rng)
    found = calibrate_hand_eye(replace(recorded(truth, joints, "charuco", rng), unit="crs97"))
    c = found.chain
    assert c.accepted
    assert c.trials[0].needed
    weights = np.ones(30)
    weights[[4, 11]] = 0.0
    told = replace(
        c,
        problem=replace(c.problem, reading_sigma=np.radians([0.01, 0.02, 0.03, 0.0, 0.0, 0.0])),
        fit=replace(c.fit, weights=(weights,)),
        suspects=(ChainSuspect("target size", 0.01, 0.002, "", 50.0, 20.0),),
        remarks=("look at this",),
    )
    return replace(found, chain=told)


def refused(found: HandEye) -> HandEye:
    return replace(found, chain=replace(found.chain, reasons=("too far off",)))


MORE = [NextPose(frozen(np.radians([10.0, -20.0, 30.0, 40.0, -50.0, 60.0])), 0.25)]
LINK_KEYS = {"dh_d_error_m": "d", "dh_a_error_m": "a", "dh_alpha_error_rad": "alpha"}


def by_name(c: ChainCalibration) -> tuple[dict[str, float], dict[str, float]]:
    """Values and standard deviations of the unknowns, SI."""
    sigma = np.sqrt(np.diag(c.covariance))
    return dict(zip(c.names, c.fit.unknowns, strict=True)), dict(zip(c.names, sigma, strict=True))


def test_each_number_of_an_arm_is_in_its_place(found: HandEye) -> None:
    said = hand_eye_json(found, MORE)
    value, sigma = by_name(found.chain)
    for key, what in {"joint_offsets_rad": "offset", **LINK_KEYS}.items():
        names = [f"J{j + 1} {what}" for j in range(6)]
        assert said[key] == [value[name] for name in names]
        assert said["std"][key] == [sigma[name] for name in names]
    for key, T, (m, rad) in (
        ("T_base_camera", found.T_base_camera, found.camera_sigma),
        ("T_gripper_target", found.T_gripper_target, found.target_sigma),
    ):
        assert said[key] == T.tolist()
        assert said["std"][key] == {"position_m": m.tolist(), "rotation_rad": rad.tolist()}
    assert said["held_out_px"] == found.chain.held_out.px
    assert said["held_out_mm"] == pytest.approx(1e3 * found.chain.held_out.metres)
    assert said["next_poses"] == [{"joints_rad": MORE[0].joints.tolist(), "gain": 0.25}]


def test_how_good_a_chain_is_goes_into_the_result(found: HandEye) -> None:
    c = refused(found).chain
    said = hand_eye_json(refused(found))
    assert said["residual_std_px"] == c.residual_std.tolist()
    assert said["corner_sigma_px"] == c.problem.pixel_sigma.tolist()
    assert said["chi2_dof"] == c.fit.chi2_dof
    assert said["held_out"] == {"px": c.held_out.px, "mm": pytest.approx(1e3 * c.held_out.metres)}
    assert (said["images"], said["wrong_images"]) == (30, [[4, 11]])
    (trial,) = c.trials
    assert said["model"] == [{"part": LINKS, "in": True, "cost_rise": trial.rise, "limit": trial.limit}]
    assert [(p["parameters"], p["correlation"]) for p in said["correlations"]] == [
        ([a, b], r) for a, b, r in c.correlations
    ]
    assert [(d["parameter"], d["share"]) for d in said["weakest_direction"]] == list(c.weakest)
    assert said["suspects"] == [
        {"name": "target size", "amount": 0.01, "std": 0.002, "sure": True, "cost_drop": 50.0}
    ]
    assert (said["verdict"], said["reasons"]) == ("refused", ["too far off"])
    assert said["remarks"] == ["look at this"]


def close(cell: str, value: float, std: float) -> bool:
    """Whether a number with its deviation says these, to the figures that it has."""
    said, about = map(float, cell.split("+-"))
    return abs(said - value) <= 0.6 * std + 1e-4 and about == pytest.approx(std, rel=0.2, abs=1e-4)


def test_tables_of_an_arm_are_in_mm_and_degrees(found: HandEye) -> None:
    (_, _, places), (_, header, joints) = hand_eye_tables(found)
    for row, T, (m, rad) in (
        (places[0], found.T_base_camera, found.camera_sigma),
        (places[1], found.T_gripper_target, found.target_sigma),
    ):
        assert [float(x) for x in row[1:4]] == pytest.approx(1e3 * T[:3, 3], abs=2e-3)
        assert float(row[4]) == pytest.approx(1e3 * np.linalg.norm(m), rel=0.2, abs=1e-3)
        assert float(row[5]) == pytest.approx(np.degrees(np.linalg.norm(rad)), rel=0.2, abs=1e-4)
    value, sigma = by_name(found.chain)
    deg = np.degrees(1.0)
    columns = {
        "zero deg": ("offset", deg),
        "d mm": ("d", 1e3),
        "a mm": ("a", 1e3),
        "alpha deg": ("alpha", deg),
    }
    assert tuple(header) == ("joint", *columns)
    for j, row in enumerate(joints):
        assert row[0] == f"J{j + 1}"
        for cell, (what, unit) in zip(row[1:], columns.values(), strict=True):
            name = f"J{j + 1} {what}"
            if what == "offset" and j in (0, 5):
                assert cell == "held"
            else:
                assert close(cell, unit * value[name], unit * sigma[name]), (name, cell)


@pytest.mark.parametrize(
    ("value", "std", "said"),
    [
        (12.34567, 0.0123, ("+12.346", "0.012")),
        (-1.0, 0.0345, ("-1.00", "0.03")),
        (0.004, 0.29, ("+0.00", "0.29")),
        (0.004, 0.31, ("+0.0", "0.3")),
        (123.4, 25.0, ("+123", "25")),
        (123.4, 7.0, ("+123", "7")),
        (1.23456, 1.5, ("+1.2", "1.5")),
        (0.5, 0.0, ("+0.5000", "0.0000")),
        (0.5, np.inf, ("+0.5000", "inf")),
    ],
)
def test_a_number_has_the_decimals_that_its_deviation_gives_a_meaning(
    value: float, std: float, said: tuple[str, str]
) -> None:
    assert with_std(value, std) == said


def nao_named(c: ChainCalibration) -> tuple[ChainCalibration, np.ndarray]:
    """The same numbers under names as a NAO's are, and their units in SI."""
    names = [f"P{i}_mm" if i % 2 else f"P{i}_deg" for i in range(len(c.names))]
    names[2] = "P2_compliance_deg_per_Nm"
    si = np.array([1e-3 if name.endswith("_mm") else np.pi / 180.0 for name in names])
    return replace(c, names=tuple(names)), si


def test_numbers_of_a_nao_are_in_the_units_of_their_names(found: HandEye) -> None:
    c, si = nao_named(found.chain)
    said = kinematic_json(c, si)
    sigma = np.sqrt(np.diag(c.covariance))
    held = [12, 17]
    assert said["held_at_zero"] == [c.names[i] for i in held]
    free = [i for i in range(len(c.names)) if i not in held]
    assert list(said["parameters"]) == [c.names[i] for i in free]
    for i in free:
        found_here = said["parameters"][c.names[i]]
        assert found_here["value"] == pytest.approx(c.fit.unknowns[i] / si[i], rel=1e-12)
        assert found_here["std"] == pytest.approx(sigma[i] / si[i], rel=1e-12)
    assert said["encoder_std_deg"] == pytest.approx([0.01, 0.02, 0.03, 0.0, 0.0, 0.0])
    ((_, _, rows),) = kinematic_tables(c, si)
    for (name, value, std, unit), i in zip(rows, free, strict=True):
        assert close(f"{value}+-{std}", c.fit.unknowns[i] / si[i], sigma[i] / si[i])
        stem, of = ("P2_compliance", "deg/Nm") if i == 2 else (f"P{i}", c.names[i].removeprefix(f"P{i}_"))
        assert (name, unit) == (stem, of)


def test_what_a_person_is_told_of_a_chain(found: HandEye) -> None:
    heard = Heard()
    tell_hand_eye(found, heard, MORE)
    c = found.chain
    assert "images:      28 of 30 used" in heard.all
    assert "left out:    4, 11 (images count from 0)" in heard.told
    assert f"chi2/dof {c.fit.chi2_dof:.3f}" in heard.all
    assert "encoders:    0.0300 deg" in heard.all
    assert f"held out:    {c.held_out.px:.3f} px, {1e3 * c.held_out.metres:.3f} mm" in heard.all
    assert "note: look at this" in heard.told
    assert "accepted" in heard.told
    (pose,) = [line for line in heard.told if line.endswith("25 %")]
    assert "off, each taken with those before it):" in heard.told[heard.told.index(pose) - 1]
    assert pose.split() == ["10.0", "-20.0", "30.0", "40.0", "-50.0", "60.0", "25", "%"]
    exact = replace(c, problem=replace(c.problem, reading_sigma=np.zeros(6)))
    heard = Heard()
    tell_hand_eye(replace(refused(found), chain=replace(exact, reasons=("too far off", "too few"))), heard)
    assert heard.told[-3:] == ["refused:", "  too far off", "  too few"]
    assert "encoders" not in heard.all
    assert "would help" not in heard.all


def test_nothing_is_told_of_images_left_out_where_none_is(found: HandEye) -> None:
    whole = replace(found.chain, fit=replace(found.chain.fit, weights=(np.ones(30),)))
    heard = Heard()
    tell_hand_eye(replace(found, chain=whole), heard)
    assert "left out" not in heard.all
    assert "(images count from 0)" not in chain_page("", "", whole, [])


@pytest.mark.parametrize(
    ("images", "said"),
    [
        ([], ""),
        ([[3]], "3"),
        ([[3, 4]], "3, 4"),
        ([[7, 8, 9, 12]], "7 to 9, 12"),
        ([[1, 5], [0, 2, 20]], "0 to 2, 5, 20"),
    ],
)
def test_numbers_of_images_in_words(images: list[list[int]], said: str) -> None:
    assert numbers(images) == said


def test_tables_of_a_page_are_as_wide_as_it_is(found: HandEye) -> None:
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    halves = page.index('<div class="two">')
    assert page.index("<h2>Places</h2>") < page.index("<h2>Arm</h2>") < halves
    assert page.index("<h2>Image by image</h2>") > halves


@dataclass
class Asked:
    """What a calibration was asked for, in place of which one that was made before is given."""

    recording: object
    limits: ChainLimits
    step: float | None


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, found: HandEye) -> list[Asked]:
    seen: list[Asked] = []

    def arm(recording: ArmRecording, limits: ChainLimits, step: float | None = None) -> HandEye:
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
def data(found: HandEye, tmp_path: Path) -> Path:
    path = tmp_path / "arm.json"
    path.write_text(json.dumps(recording_json(found.recording)))
    return path


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
    result = hand_eye_step(data, tmp_path / "c.toml", None, 0.7, 0.5, heard)
    (ask,) = asked
    assert ask.limits == replace(HAND_EYE_LIMITS, held_out=pytest.approx(0.7e-3))
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
    tested = "squared errors are 1.02 of the predicted ones (chance: 0.70 to 1.30), as predicted"
    assert tested in heard.all
    assert f"Self-test:</b> on 4 synthetic twins {tested}" in (tmp_path / "c.html").read_text()
    assert any(line.endswith("25 %") for line in heard.told)
    assert (tmp_path / "c.html").exists()
    assert "was written" not in heard.all
    heard = Heard()
    assert hand_eye_step(data, tmp_path / "c.toml", None, None, None, heard)["id"] == result["id"]
    assert any(line.startswith("written:") for line in heard.told), "over the one of before"


UNNAMED = "so no cell takes this calibration"


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (
            {},
            "name it in the cell file of the crs97, relative to that file's folder; if it stands beside it: "
            'calibration = "c.toml"',
        ),
        (
            {"unit": ""},
            f"the recording is of no unit, {UNNAMED}: give the recording a key unit (crs93 or crs97)",
        ),
        ({"unit": "mine"}, f"the recording is of unit 'mine', {UNNAMED}"),
        ({"dh": replace(NOMINAL, d=frozen(NOMINAL.d + 0.1))}, f"are not the numbers of the A465, {UNNAMED}"),
    ],
)
def test_what_is_to_be_done_with_a_calibration_is_told_as_it_is(
    found: HandEye, asked: list[Asked], tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    data = tmp_path / "arm.json"
    data.write_text(json.dumps(recording_json(replace(found.recording, **changed))))
    heard = Heard()
    hand_eye_step(data, tmp_path / "out" / "c.toml", None, None, None, heard)
    assert words in heard.told[-1]
    assert ("name it" in heard.all) == (not changed)


def test_a_cell_that_is_known_gets_the_name_from_where_it_is(
    found: HandEye, asked: list[Asked], data: Path, tmp_path: Path
) -> None:
    cell, output = tmp_path / "cells" / "cell.toml", tmp_path / "out" / "c.toml"
    cell.parent.mkdir()
    heard = Heard()
    solve_hand_eye(
        data,
        found.recording,
        Results(output, None),
        HAND_EYE_LIMITS,
        None,
        heard,
        cell_file=cell,
        apply=False,
    )
    assert heard.told[-1] == f'name it in {cell}: calibration = "../out/c.toml"'


def test_without_a_file_to_write_none_is_written_and_that_is_told(
    asked: list[Asked], data: Path, tmp_path: Path
) -> None:
    heard = Heard()
    result = hand_eye_step(data, None, tmp_path / "r.html", None, None, heard)
    assert (asked[0].limits, asked[0].step) == (HAND_EYE_LIMITS, None)
    assert "no calibration file was written: -o FILE writes it" in heard.told
    assert "id" not in result
    assert {path.name for path in tmp_path.iterdir()} == {"arm.json", "r.html"}


def test_what_is_refused_is_reported_and_neither_tested_nor_written(
    found: HandEye, asked: list[Asked], data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(calibratechain, "calibrate_hand_eye", lambda *_: refused(found))
    result = hand_eye_step(data, tmp_path / "c.toml", tmp_path / "r.html", None, None, Heard())
    assert result["verdict"] == "refused"
    assert "self_test" not in result
    assert {path.name for path in tmp_path.iterdir()} == {"arm.json", "r.html"}
    assert "Self-test:</b> not made" in (tmp_path / "r.html").read_text()
    heard = Heard()
    hand_eye_step(data, None, None, None, None, heard)
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
        solve_hand_eye(data, found.recording, Results(None, None), HAND_EYE_LIMITS, None, Heard(), pool=given)
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
        assert "2.00 of the predicted ones (chance: 0.70 to 1.30), NOT as predicted" in reason
        assert f"refused: {reason}; {tmp_path / output} was not written" in told
        assert not (tmp_path / output).exists()
        page = (tmp_path / "c.html").read_text()
        assert "refused" in page
        assert page.count("NOT as predicted") == 2


def test_the_result_of_a_nao_is_written_as_it_is_told(
    found: HandEye, asked: list[Asked], nao_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard = Heard()
    result = kinematic_step(nao_data, tmp_path / "found.json", None, 3.0, 0.1, heard)
    (ask,) = asked
    # images 4 and 11 of the left leg, of which every other image of the file is
    assert result["wrong_images"] == [[8, 22]]
    assert "left out:    8, 22 (images count from 0)" in heard.told
    assert "without 8, 22 (images count from 0)" in (tmp_path / "found.html").read_text()
    assert ask.limits == replace(NAO_LIMITS, held_out=pytest.approx(3e-3))
    assert ask.step == pytest.approx(np.radians(0.1))
    assert json.loads((tmp_path / "found.json").read_text()) == result
    assert result["self_test"]["passed"] is True
    assert (tmp_path / "found.html").exists()
    kinematic_step(nao_data, None, None, None, None, Heard())
    assert (asked[1].limits, asked[1].step) == (NAO_LIMITS, None)
    bad = replace(nao_named(found.chain)[0], reasons=("too far off",))
    monkeypatch.setattr(calibratechain, "calibrate_nao", lambda *_: bad)
    assert "self_test" not in kinematic_step(nao_data, tmp_path / "other.json", None, None, None, Heard())
    assert not (tmp_path / "other.json").exists()
    assert (tmp_path / "other.html").exists()


STEPS = pytest.mark.parametrize("step", [hand_eye_step, kinematic_step])


@STEPS
@pytest.mark.parametrize(
    ("limit_mm", "encoder_step_deg", "words"),
    [
        (0.0, None, "--limit-mm 0: must be above 0 mm"),
        (-1.0, None, "--limit-mm -1: must be above 0 mm"),
        (np.inf, None, "--limit-mm inf: must be above 0 mm, and a number"),
        (np.nan, None, "--limit-mm nan: must be above 0 mm, and a number"),
        (None, -0.1, "--encoder-step-deg -0.1: must be from 0 to 5 deg"),
        (None, 5.1, "--encoder-step-deg 5.1: must be from 0 to 5 deg"),
        (None, np.nan, "--encoder-step-deg nan: must be from 0 to 5 deg"),
    ],
)
def test_options_are_seen_before_anything_is_read(
    tmp_path: Path, step: Step, limit_mm: float | None, encoder_step_deg: float | None, words: str
) -> None:
    with pytest.raises(InputError) as told:
        step(tmp_path / "gone.json", None, None, limit_mm, encoder_step_deg, Heard())
    assert words in str(told.value)


@pytest.mark.parametrize("deg", [0.0, 5.0])
def test_exact_and_very_coarse_encoders_may_be_stated(asked: list[Asked], data: Path, deg: float) -> None:
    hand_eye_step(data, None, None, None, deg, Heard())
    assert asked[0].step == pytest.approx(np.radians(deg))


@STEPS
@pytest.mark.parametrize(
    ("output", "report", "words"),
    [
        ("data.json", None, "data.json: is read by this command"),
        ("c.toml", "data.json", "data.json: is read by this command"),
        ("folder", None, "is no ordinary file"),
        ("c.toml", "folder", "is no ordinary file"),
        ("page.html", None, "is the name of the report too"),
        ("c.toml", "folder/../c.toml", "is the name of the report too"),
    ],
)
def test_files_that_cannot_be_written_are_refused_before_anything_is_read(
    tmp_path: Path, step: Step, output: str, report: str | None, words: str
) -> None:
    (tmp_path / "folder").mkdir()
    data = tmp_path / "data.json"
    data.write_text("not a recording")
    with pytest.raises(InputError) as told:
        step(data, tmp_path / output, None if report is None else tmp_path / report, None, None, Heard())
    assert words in str(told.value)
    assert data.read_text() == "not a recording"


OTHERS = (
    "scenes/cell.toml",
    "scenes/task2.toml",
    "scenes/task2.world.toml",
    "scenes/cameras/lab.toml",
    "scenes/targets/hand.toml",
    "urdf/a465/a465.urdf",
)


@STEPS
@pytest.mark.parametrize("as_report", [False, True])
@pytest.mark.parametrize("other", [*OTHERS, "board"])
def test_no_file_of_another_kind_is_written_over(
    tmp_path: Path, step: Step, as_report: bool, other: str
) -> None:
    file = sorted(data_file("scenes").rglob("*.csv"))[0] if other == "board" else data_file(other)
    there = tmp_path / file.name
    shutil.copyfile(file, there)
    given = (tmp_path / "new.toml", there) if as_report else (there, None)
    with pytest.raises(InputError, match="that this command wrote, so it is not written over") as told:
        step(tmp_path / "not read.json", *given, None, None, Heard())
    assert str(there) in str(told.value)
    assert there.read_bytes() == file.read_bytes()


@STEPS
def test_a_name_that_can_have_no_folder_is_refused_before_anything_is_read(
    tmp_path: Path, step: Step
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="nothing can be written in") as told:
        step(tmp_path / "not read.json", tmp_path / "file" / "x" / "c.toml", None, None, None, Heard())
    assert str(tmp_path / "file") in str(told.value)


@STEPS
@pytest.mark.parametrize("name", ["", ".", "/", "loop.toml", "loop.toml/c.toml", "x" * 300 + ".toml"])
def test_what_is_no_name_of_a_file_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: Step, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.toml").symlink_to("loop.toml")
    for given in ((Path(name), None), (None, Path(name))):
        with pytest.raises(InputError, match="file") as told:
            step(Path("not read.json"), *given, None, None, Heard())
        assert "not read" not in str(told.value)
        assert len(str(told.value).splitlines()) == 1
