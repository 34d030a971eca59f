"""What changed between two files is listed in their own terms, with what its errors allow; two kinds are refused."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, read_arm_calibration, write_arm_calibration
from arm.errors import InputError
from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.robot.link_errors import LinkErrors
from arm.se3 import rotation, transform
from cell.compare.compare import differences
from typed.command_line import a465, replace_in

REALISTIC = data_file("scenes/realistic/calibration.toml")


def _changed(seed: int) -> tuple[ArmCalibration, ArmCalibration, np.ndarray, float, np.ndarray]:
    """A calibration, and it again with other numbers: motion of the camera, its angle, changes of the offsets."""
    rng = np.random.default_rng(seed)
    first = read_arm_calibration(REALISTIC)
    shift, axis, angle = rng.normal(0.0, 0.002, 3), rng.normal(0.0, 1.0, 3), rng.uniform(0.001, 0.01)
    T = transform(rotation(angle * axis / np.linalg.norm(axis)), shift)
    offsets = rng.normal(0.0, 0.005, 6) * (rng.random(6) < 0.5)
    second = replace(
        first, T_base_camera=mul(first.T_base_camera, T), joint_offsets=first.joint_offsets + offsets
    )
    return first, second, shift, angle, offsets


@pytest.mark.parametrize("seed", range(4))
def test_calibrations_say_how_far_camera_and_joints_moved_and_how_sure_that_is(
    tmp_path: Path, seed: int
) -> None:
    first, second, shift, angle, offsets = _changed(seed)
    for name, one in (("a.toml", first), ("b.toml", second)):
        write_arm_calibration(tmp_path / name, one)
    found = {change.what: change for change in differences(tmp_path / "a.toml", tmp_path / "b.toml")}
    assert set(found) == {
        "camera moved mm",
        "camera turned deg",
        *(f"J{k + 1} offset deg" for k in np.flatnonzero(offsets)),
    }
    assert found["camera moved mm"].by == pytest.approx(1e3 * np.linalg.norm(shift))
    assert found["camera turned deg"].by == pytest.approx(np.degrees(angle))
    assert first.covariance is not None
    sd = np.sqrt(2.0 * np.diag(first.covariance))
    assert found["camera moved mm"].sd == pytest.approx(1e3 * np.linalg.norm(sd[:3]))
    for k in np.flatnonzero(offsets):
        of = found[f"J{k + 1} offset deg"]
        assert of.by == pytest.approx(np.degrees(offsets[k]))
        assert of.sd == pytest.approx(np.degrees(sd[6 + k]))


def test_links_and_lens_of_a_calibration_without_covariance(tmp_path: Path) -> None:
    first = replace(read_arm_calibration(REALISTIC), covariance=None)
    links = LinkErrors(first.links.d, first.links.a + np.array([0, 0, 1e-4, 0, 0, 0]), first.links.alpha)
    assert first.intrinsics is not None
    second = replace(first, links=links, intrinsics=first.intrinsics + np.eye(9)[2])
    for name, one in (("a.toml", first), ("b.toml", second)):
        write_arm_calibration(tmp_path / name, one)
    found = {c.what: (c.by, c.sd) for c in differences(tmp_path / "a.toml", tmp_path / "b.toml")}
    assert found == {"J3 link a mm": (pytest.approx(0.1), None), "cx px": (pytest.approx(1.0), None)}


def test_keys_of_cells_and_of_the_files_that_they_name(tmp_path: Path) -> None:
    scenes = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes"))
    task, own = data_file("scenes/realistic/task2.toml"), scenes / "realistic/task2.toml"
    assert list(differences(task, own)) == []
    replace_in(scenes / "realistic/cell.toml", "clearance_mm = 10", "clearance_mm = 8")
    other = replace(read_arm_calibration(REALISTIC), joint_offsets=np.zeros(6))
    write_arm_calibration(scenes / "realistic/calibration.toml", other)
    found = {(c.file, c.what): (c.first, c.second) for c in differences(task, own)}
    assert found["cell.toml", "motion.clearance_mm"] == (10.0, 8.0)
    assert [key for key in found if key[0] == "cell.toml"] == [("cell.toml", "motion.clearance_mm")]
    assert {key[1] for key in found if key[0] == "calibration.toml"} == {
        f"J{k} offset deg" for k in range(1, 7)
    }
    said, _ = a465("compare", task, own)
    assert "motion.clearance_mm  10" in said
    assert f"{len(found)} differences" in said


def test_files_of_other_names_and_the_same_content_are_no_difference(scenes: Path) -> None:
    own = scenes / "own/cell.toml"
    shutil.copytree(scenes / "boards", scenes / "own/plates")
    shutil.copytree(scenes / "cameras", scenes / "own/cameras")
    shutil.copy(scenes / "cell.toml", own)
    own.write_text(own.read_text().replace('"boards/', '"plates/'))
    assert list(differences(scenes / "cell.toml", own)) == []
    plate = next((scenes / "own/plates").glob("*01-02.csv"))
    plate.write_text(plate.read_text() + "\n")
    assert [change.what for change in differences(scenes / "cell.toml", own)] == ["boards.files"]


def test_plans_differ_by_what_they_are_made_for_and_by_their_motions(tmp_path: Path) -> None:
    entries = [{"q_deg": [0, -10, -90, 0, -70, 0]}, {"q_deg": [20, -10, -90, 0, -70, 0]}]
    (tmp_path / "list.json").write_text(json.dumps({"frame": "tool", "entries": entries}))
    for name, speed in (("a.json", 0.5), ("b.json", 0.4), ("c.json", 0.5)):
        cell = data_file("scenes/cell.toml")
        a465("plan", cell, tmp_path / "list.json", "-o", tmp_path / name, "--speed", speed)
    found = {c.what: c for c in differences(tmp_path / "a.json", tmp_path / "b.json")}
    assert (found["speed"].first, found["speed"].second) == (0.5, 0.4)
    assert found["motion s"].by is not None
    assert found["motion s"].by > 0.0
    assert any(what.endswith(" s") and what.startswith("to ") for what in found)
    assert list(differences(tmp_path / "a.json", tmp_path / "c.json")) == []
    (tmp_path / "list.json").write_text(json.dumps({"frame": "tool", "entries": entries[:1]}))
    a465("plan", data_file("scenes/cell.toml"), tmp_path / "list.json", "-o", tmp_path / "d.json")
    found = {c.what: c for c in differences(tmp_path / "a.json", tmp_path / "d.json")}
    assert found["steps"].first.startswith("2 steps, ")
    assert found["steps"].second == "1 steps"
    with pytest.raises(
        InputError, match=r"a.json is a plan, .*cell.toml is a cell file; must be two of a kind"
    ):
        list(differences(tmp_path / "a.json", data_file("scenes/cell.toml")))
    for name, words in (
        ("scenes/where-boards-may-stand.toml", "a study file"),
        ("urdf/a465/crs93.toml", "a unit file"),
        ("scenes/faults/bad-day.toml", "a file of faults"),
    ):
        with pytest.raises(InputError, match=f"{words}, .* is a cell file; must be two of a kind"):
            list(differences(data_file(name), data_file("scenes/cell.toml")))


def test_unit_files_that_two_cells_name_are_compared_and_names_are_not_files(tmp_path: Path) -> None:
    text = data_file("urdf/a465/crs97.toml").read_text().replace('"crs97"', '"hall"')
    for name, margin in (("a", "1.0"), ("b", "1.5")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "hall.toml").write_text(text.replace("margin_deg = 1.0", f"margin_deg = {margin}"))
        cell = data_file("scenes/cell.toml").read_text().replace('unit = "crs93"', 'unit = "hall.toml"')
        (tmp_path / name / "cell.toml").write_text(cell)
        shutil.copytree(data_file("scenes/cameras"), tmp_path / name / "cameras")
    first, second = tmp_path / "a/cell.toml", tmp_path / "b/cell.toml"
    (change,) = differences(first, second)
    assert (change.file, change.what, change.first, change.second) == (
        "hall.toml",
        "limits.margin_deg",
        1.0,
        1.5,
    )
    replace_in(second, 'unit = "hall.toml"', 'unit = "crs97"')
    (change,) = differences(first, second)
    assert (change.what, change.first, change.second) == ("unit", "hall.toml", "crs97")
    replace_in(first, 'unit = "hall.toml"', 'unit = "crs93"')
    (change,) = differences(first, second)
    assert (change.what, change.first, change.second) == ("unit", "crs93", "crs97")


def test_a_file_that_cannot_be_compared_is_told_with_what_can(tmp_path: Path) -> None:
    look = tmp_path / "look.json"
    look.write_text('{"scenes": []}')
    _, told = a465("compare", look, look, code=2)
    assert (
        f"{look}: is a look, which cannot be compared (cell, task, program, arm, calibration, camera and"
        in told
    )
