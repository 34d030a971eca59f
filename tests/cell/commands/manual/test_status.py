"""Where the arm is, without setting anything; and who has the port."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.io.storage import data_file
from cell.config.cell_file import read_cell
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from emulated.on_pty import names_to, on_pty
from typed.command_line import a465

CELL = data_file("scenes/cell.toml")
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}


@pytest.fixture
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def port(unit: Unit, tmp_path: Path) -> Iterator[tuple[Emulator, str]]:
    """A homed arm."""
    with on_pty(unit, tmp_path / "unit.jsonl", homed_deg=np.degrees(unit.soft_home)) as served:
        yield served


def test_an_arm_that_was_not_homed_has_no_position(unit: Unit, tmp_path: Path) -> None:
    with on_pty(unit, tmp_path / "unit.jsonl") as (_, port):
        _told_without_a_position(port, tmp_path)


def _told_without_a_position(port: str, tmp_path: Path) -> None:
    said, _ = a465("status", port, cwd=tmp_path)
    assert "arm power on, motion stop not pressed, no axis in error, at rest" in said
    assert "whether the motors hold the arm is not reported" in said
    assert "NOT HOMED since it was switched on" in said
    assert " deg" not in said
    said, _ = a465("status", port, "--cell", CELL, "--json", cwd=tmp_path)
    state = json.loads(said)
    assert (state["referenced"], state["q_deg"], state["tool_mm"]) == (False, None, None)
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_an_arm_that_was_homed_is_where_its_counters_say(
    port: tuple[Emulator, str], unit: Unit, tmp_path: Path
) -> None:
    name = port[1]
    said, _ = a465("status", name, "--cell", CELL, "--json", cwd=tmp_path)
    state = json.loads(said)
    assert state["held_by"] is None
    assert (state["unit"], state["unit_by"], state["referenced"], state["moving"]) == (
        "crs93",
        "cell file",
        True,
        False,
    )
    np.testing.assert_allclose(state["q_deg"], np.degrees(unit.soft_home), atol=2e-3)
    cell = read_cell(CELL)
    tool = cell.robot().T_base_tool(cell.unit.positions(state["counts"]))
    np.testing.assert_allclose(state["tool_mm"], 1e3 * tool[:3, 3], atol=0.01)
    np.testing.assert_allclose(state["T_base_tool"], tool, atol=1e-12)
    assert 0.0 < state["jaws_mm"] <= 60.0
    said, _ = a465("status", name, cwd=tmp_path)
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES
    assert "crs93, by the axis of its gripper; --cell CELL states it" in said
    assert "J1 to J6: " in said


def test_faults_are_told(port: tuple[Emulator, str], tmp_path: Path) -> None:
    port[0].set_motion_stop(True)
    said, _ = a465("status", port[1], cwd=tmp_path)
    assert "motion stop PRESSED" in said
    state = json.loads(a465("status", port[1], "--json", cwd=tmp_path)[0])
    assert state["motion_stop"] is True
    assert "motion stop is pressed" in state["faults"]


def test_the_cell_of_another_arm_is_refused(tmp_path: Path) -> None:
    with on_pty(load_unit("crs97"), tmp_path / "unit.jsonl") as (_, port):
        _, told = a465("status", port, "--cell", CELL, code=2, cwd=tmp_path)
        assert "this arm has it on axis H" in told
        said, _ = a465("status", port, cwd=tmp_path)
        assert "unit: crs97" in said
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_who_has_the_port_is_named_with_what_it_does(
    port: tuple[Emulator, str], unit: Unit, tmp_path: Path
) -> None:
    emulator, name = port
    log, clock = tmp_path / "runs/work-1/wire.jsonl", Clock(10.0)
    with WireLog(log, clock) as wire, Mars(name, unit, clock, wire) as mars:
        mars.identify()
        mars.initialise(home=False)
        mars.note("run", unit=unit.name)
        mars.note("step", index=3, name="cube 1: approach")
        at, heard = mars.counts(), len(emulator.lines)
        state = json.loads(a465("status", name, "--json", cwd=tmp_path)[0])
        assert emulator.lines[heard:] == (), "the unit was not asked"
        said, _ = a465("status", name, cwd=tmp_path)
    assert state["held_by"]["pid"] == os.getpid()
    assert state["held_by"]["folder"] == str(log.parent)
    assert state["doing"] == "cube 1: approach"
    assert state["counts"] == list(at)
    np.testing.assert_allclose(state["q_deg"], np.degrees(unit.positions(at)), atol=1e-3)
    assert f"process {os.getpid()}" in said
    assert str(log) in said
    assert "cube 1: approach" in said


def test_a_port_without_a_unit_is_wrong_input(tmp_path: Path) -> None:
    _, told = a465("status", tmp_path / "none", code=2, cwd=tmp_path)
    assert "is not there" in told
    ran = subprocess.run(
        [sys.executable, "-m", "a465", "status"], capture_output=True, text=True, check=False
    )
    assert ran.returncode == 2
