"""A unit file of one's own works from the plan to the log, and what is of another unit is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.controller.unit import Unit, load_unit, noted_unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.plan_file import read_plan
from arm.se3 import frozen
from cell.commands.emulate import _unit
from cell.config.cell_file import read_cell
from cell.files.task import read_task
from cell.session.connection import simulated_cell
from driver.log.read import read_log
from emulated.on_pty import lines_to, on_pty
from tasks.small import quick_scenes
from typed.command_line import a465, replace_in

pytestmark = pytest.mark.xdist_group("own_unit")
NAME, ZERO, SPEED = "hall-3", 3252, 7000  # of axis B at J2 = 0, of which the crs97 has 252; and of axis A


def write_unit(file: Path) -> Path:
    """A unit that differs from the crs97 in a zero and a register."""
    text = data_file("urdf/a465/crs97.toml").read_text()
    for old, new in (
        ('"crs97"', f'"{NAME}"'),
        ("[-182500, 252,", f"[-182500, {ZERO},"),
        ("= [7680,", f"= [{SPEED},"),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    file.write_text(text)
    return file


def with_own_unit(scenes: Path) -> Path:
    """The scenes, with a unit file beside the cell file."""
    file = write_unit(scenes / "hall.toml")
    replace_in(scenes / "cell.toml", 'unit = "crs93"', f'unit = "{file.name}"')
    return scenes


@pytest.fixture
def own(scenes: Path) -> Path:
    return with_own_unit(scenes)


def test_a_new_cell_takes_a_copy_of_the_unit_file(tmp_path: Path) -> None:
    file = write_unit(tmp_path / "hall.toml")
    said, _ = a465("new-cell", "mine", "--unit", "hall.toml", "--json", cwd=tmp_path)
    file.unlink()
    assert json.loads(said)["unit"] == NAME
    unit = read_cell(tmp_path / "mine/cell.toml").unit
    assert (unit.name, int(unit.counts(np.zeros(6))[1])) == (NAME, ZERO)
    assert "hall.toml: " in a465("new-cell", "other", "--unit", "hall.toml", code=2, cwd=tmp_path)[1]
    assert not (tmp_path / "other").exists()


def test_a_cell_has_the_unit_of_its_file(own: Path) -> None:
    cell, shipped = read_cell(own / "cell.toml"), load_unit("crs97")
    assert (cell.unit.name, int(cell.unit.counts(np.zeros(6))[1]), cell.speed_registers[0]) == (
        NAME,
        ZERO,
        SPEED,
    )
    assert cell.unit.digest == load_unit(own / "hall.toml").digest != shipped.digest


def test_a_log_holds_the_unit_and_of_a_shipped_one_its_name(own: Path) -> None:
    cell = read_cell(own / "cell.toml")
    noted = json.loads(json.dumps(cell.noted()))
    (own / "hall.toml").unlink()
    again = noted_unit(noted)
    assert isinstance(again, Unit)
    assert (again.name, again.digest) == (NAME, cell.nominal_unit.digest)
    np.testing.assert_array_equal(again.counts(cell.q_start), cell.nominal_unit.counts(cell.q_start))
    assert read_cell(data_file("scenes/cell.toml")).noted() == {"unit": "crs93"}
    assert noted_unit({"unit": NAME}) is None
    with pytest.raises(InputError, match=f"{NAME}.toml: axes"):
        noted_unit({**noted, "unit_file": noted["unit_file"].replace('axes = ["A"', 'axes = ["B"')})


@pytest.mark.parametrize("unit", ["crs97", "crs93", "", "hall-4"])
def test_a_calibration_of_another_unit_is_refused(own: Path, unit: str) -> None:
    cell = read_cell(own / "cell.toml")
    made = ArmCalibration(cell.camera.T_base_camera, frozen(np.full(6, 1e-3)), unit=NAME)
    replace_in(own / "cell.toml", "[tool]", 'calibration = "made.toml"\n\n[tool]')
    write_arm_calibration(own / "made.toml", made)
    assert read_cell(own / "cell.toml").calibration is not None
    write_arm_calibration(own / "made.toml", replace(made, unit=unit))
    with pytest.raises(
        InputError, match=f"(is of {unit}|names no unit), but unit is {NAME}; calibrate this arm"
    ):
        read_cell(own / "cell.toml")


def test_an_emulated_unit_is_named_by_its_file_or_by_its_task(own: Path) -> None:
    assert _unit(str(own / "hall.toml"), None).name == NAME
    simulated = simulated_cell(read_task(own / "task2.toml"), None)
    for name in (None, NAME, str(own / "hall.toml")):
        assert _unit(name, simulated) is simulated.cell.nominal_unit
    for name in ("crs97", "hall-4"):
        with pytest.raises(
            InputError, match=r"the task's cell has hall-3|must be one of crs93, crs97, or a unit file"
        ):
            _unit(name, simulated)


def test_a_scene_file_takes_it_too(own: Path) -> None:
    scene = next(file for file in (own / "fixtures").glob("free_space.toml"))
    write_unit(own / "fixtures/hall.toml")
    replace_in(scene, 'unit = "crs', 'unit = "hall.toml" # "crs')
    a465("check", scene)
    replace_in(own / "fixtures/hall.toml", "margin_deg = 1.0", "margin = 1.0")
    assert "hall.toml: limits.margin_deg: is missing" in a465("check", scene, code=2)[1]


@pytest.mark.slow
def test_homing_sends_its_registers_and_status_tells_its_angles(own: Path, tmp_path: Path) -> None:
    cell = read_cell(own / "cell.toml")
    with on_pty(cell.nominal_unit, tmp_path / "unit.jsonl", homed_deg=np.degrees(cell.q_start)) as (_, port):
        said, _ = a465("status", port, "--cell", own / "cell.toml", cwd=tmp_path)
        assert f"unit: {NAME}, by the cell file" in said
        assert "J1 to J6: -60.00, -40.00, -80.00, 0.00, -60.00, 0.00 deg" in said
        a465("home", own / "cell.toml", port, "--speed", "1", "--free", cwd=tmp_path)
    sent = lines_to(tmp_path / "unit.jsonl")
    assert f"REGMSA:{SPEED}" in sent
    assert "REGMSA:7680" not in sent


@pytest.mark.slow
def test_from_the_plan_to_the_log(tmp_path: Path) -> None:
    scenes = with_own_unit(quick_scenes(tmp_path, 1))
    task, unit, plan, look = (scenes / name for name in ("task2.toml", "hall.toml", "plan.json", "look.json"))
    a465("look", task, "-o", look)
    a465("plan", task, "--look", look, "-o", plan)
    assert read_plan(plan).unit == NAME
    said, _ = a465("execute", plan, task, "--time-scale", "100", "--json", cwd=tmp_path)
    report = json.loads(said)
    assert [cube["placed"] for cube in report["cubes"]] == [True]
    log = Path(tmp_path / report["folder"]) / "wire.jsonl"
    start = read_cell(scenes / "cell.toml").unit.counts(read_cell(scenes / "cell.toml").q_start)
    assert "COORDSPLINET" in {line.text.partition(":")[0] for line in read_log(log).sent}
    assert list(read_plan(plan).start) == start.tolist()

    # the log can be read where the unit file is not
    away = tmp_path / "away"
    away.mkdir()
    (away / "wire.jsonl").write_bytes(log.read_bytes())
    said, _ = a465("export", away / "wire.jsonl", "--format", "csv", "--json", cwd=away)
    assert json.loads(said)["unit"] == NAME
    a465("export", away / "wire.jsonl", "--unit", unit, "--format", "csv", cwd=away)
    refused = a465("export", away / "wire.jsonl", "--unit", "crs97", "--format", "csv", code=2, cwd=away)[1]
    assert f"--unit crs97: the log is of {NAME}" in refused
    assert "is no shipped unit" in a465("export", plan, "--format", "csv", code=2, cwd=away)[1]
    a465("export", plan, "--format", "csv", "--cell", task, "-o", away / "plan.csv")

    # a plan is for this unit as it is, and for no other
    a465("check", plan, task)
    replace_in(unit, str(ZERO), str(ZERO + 10))
    assert "unit " in a465("check", plan, task, code=3)[1]
    replace_in(scenes / "cell.toml", f'unit = "{unit.name}"', 'unit = "crs97"')
    assert (
        f"the plan is for unit {NAME}, but task2.toml is of unit crs97"
        in a465("check", plan, task, code=3)[1]
    )
