"""The motors of a resting arm are switched off once a person has agreed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ExecutionStopped, InputError
from cell.commands.manual.release import release_step
from cell.config.cell import Cell
from cell.session.ports import PortAndPlace
from emulated.on_pty import lines_to, names_to, on_pty
from emulated.stepped_cell import push_to
from typed.command_line import a465
from typed.heard import Heard

AT = (10.0, -20.0, -60.0, 5.0, -60.0, 0.0)
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}


def test_a_person_who_types_the_word_switches_the_motors_off(
    here: Cell, tmp_path: Path, answers: Callable[..., None]
) -> None:
    console, asked, log = Heard(), [], tmp_path / "unit.jsonl"
    sunk = here.unit.counts(np.radians(AT)) + np.array([0, -1500, 0, 0, 0, 0])
    with on_pty(here.unit, log, homed_deg=AT) as (emulator, port):

        def answer() -> str:
            asked.append((console.all, names_to(log)))
            push_to(emulator, sunk)  # as it would sink
            return "release"

        answers(answer)
        report = release_step(PortAndPlace(port, None), False, console)
    ((told, sent),) = asked
    assert "THE ARM MAY DROP" in told
    assert "J1 to J6: 10.00, -20.00" in told
    assert sent <= QUERIES
    assert [line for line in lines_to(log) if line.partition(":")[0] not in QUERIES] == ["RELEASE:"]
    assert report["counts"] == sunk.tolist()
    assert "the joints have turned by at most 1.35 deg" in console.all
    records = map(json.loads, Path("runs/release-1/wire.jsonl").read_text().splitlines())
    assert any("RELEASE:" in record.get("data", "") for record in records)


def test_without_the_word_the_unit_gets_queries_only(
    here: Cell, tmp_path: Path, answers: Callable[..., None]
) -> None:
    answers(lambda: "yes")
    with (
        on_pty(here.unit, tmp_path / "unit.jsonl", homed_deg=AT) as (_, port),
        pytest.raises(InputError, match="'release' was not typed; nothing moved"),
    ):
        release_step(PortAndPlace(port, None), False, Heard())
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_a_moving_arm_is_not_released(here: Cell, tmp_path: Path) -> None:
    with on_pty(here.unit, tmp_path / "unit.jsonl", homed_deg=AT) as (emulator, port):
        emulator.machine.run_axis("A", 5.0)
        with pytest.raises(ExecutionStopped, match=f"a465 stop {port} stops it"):
            release_step(PortAndPlace(port, None), True, Heard())
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_an_arm_that_moves_while_the_person_reads_is_not_released(
    here: Cell, tmp_path: Path, answers: Callable[..., None]
) -> None:
    with on_pty(here.unit, tmp_path / "unit.jsonl", homed_deg=AT) as (emulator, port):

        def answer() -> str:
            emulator.machine.run_axis("A", 5.0)
            return "release"

        answers(answer)
        with pytest.raises(
            ExecutionStopped, match=f"moves now, so it is not released: a465 stop {port} stops it"
        ):
            release_step(PortAndPlace(port, None), False, Heard())
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


def test_nobody_to_ask_is_refused_before_a_port_is_opened(tmp_path: Path) -> None:
    _, told = a465("release", "/dev/null", code=2)
    assert "no terminal to confirm that the arm may drop: give --supported" in told
    assert list(tmp_path.iterdir()) == []
