"""STOP reaches the arm, whoever has the port, and what happened is told."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import cell.commands.manual.stop
from arm.controller.unit import load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock
from driver.mars.mars import Mars
from emulated.on_pty import lines_to, names_to, on_pty
from typed.command_line import a465

from .conftest import CELL

MOVES = """
import sys
import numpy as np
from pathlib import Path
from arm.controller.unit import load_unit
from driver.line.clock import Clock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
unit, clock = load_unit("crs93"), Clock()
with WireLog(Path(sys.argv[2]), clock) as log, Mars(sys.argv[1], unit, clock, log) as mars:
    mars.identify()
    mars.initialise(home=False)
    print("moves", flush=True)
    mars.move_to(unit.counts(unit.soft_home + np.radians([60, 0, 0, 0, 0, 0])))
"""
DEAF = """
import signal, sys, time
from arm.io.claim import Claim
signal.signal(signal.SIGINT, signal.SIG_IGN)
claim = Claim("port " + sys.argv[-1], brief="brief" in sys.argv)
print("deaf", flush=True)
time.sleep(600)
"""


@pytest.fixture
def port(tmp_path: Path) -> Iterator[tuple[Emulator, str]]:
    """A homed arm in wall time."""
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl", 1.0, homed_deg=(0, 0, -45, 0, -45, 0)) as served:
        yield served


@contextmanager
def _other(code: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Another program, which is killed at the end if it is still there."""
    command = [sys.executable, "-c", code, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline()
            yield other
        finally:
            other.kill()


@pytest.mark.slow
@pytest.mark.parametrize("suspended", [False, True], ids=["running", "suspended by Ctrl-Z"])
def test_another_program_that_moves_the_arm_is_interrupted(
    port: tuple[Emulator, str], tmp_path: Path, suspended: bool
) -> None:
    emulator, name = port
    with _other(MOVES, name, str(tmp_path / "runs/x-1/wire.jsonl")) as other:
        over = time.monotonic() + 60.0
        while not any(line.startswith("COORDMV") for line in lines_to(tmp_path / "unit.jsonl")[-3:]):
            assert time.monotonic() < over
            time.sleep(0.05)
        if suspended:
            other.send_signal(signal.SIGSTOP)
        said, _ = a465("stop", name, "--json", cwd=tmp_path)
        assert other.wait(60) != 0
        assert other.stderr is not None
        assert "interrupted" in other.stderr.read()
    told = json.loads(said)
    assert told["interrupted"]["pid"] == other.pid
    assert told["interrupted"]["log"].endswith("runs/x-1/wire.jsonl")
    assert (told["moving"], told["arm_power"]) == (False, True)
    assert tuple(told["counts"]) == emulator.counts()
    sent = lines_to(tmp_path / "unit.jsonl")
    moved = max(i for i, line in enumerate(sent) if line.startswith("COORDMV"))
    assert "STOP:" in sent[moved:]


def test_an_arm_that_nobody_has_is_stopped_by_queries_and_stop_alone(
    port: tuple[Emulator, str], tmp_path: Path
) -> None:
    """The program that started the motion was killed, and the unit goes on with it."""
    emulator, name = port
    unit, clock = load_unit("crs93"), Clock()
    mars = Mars(name, unit, clock)
    mars.identify()
    mars.initialise(home=False)
    target = unit.counts(unit.soft_home)
    target[0] += 60_000
    mars.link.send("COORDMV:" + ",".join(map(str, target)))
    mars.link.synchronise()
    mars.link.close()
    heard = len(lines_to(tmp_path / "unit.jsonl"))
    said, _ = a465("stop", name, cwd=tmp_path)
    assert "STOP was sent; the arm is at rest" in said
    assert emulator.counts()[0] != target[0]
    sent = {line.partition(":")[0] for line in lines_to(tmp_path / "unit.jsonl")[heard:]}
    assert sent <= {"ECHO", "STAMP", "VER?", "STOP", "ST?", *(f"AP{a}?" for a in "ABCDEFGH")}
    assert "STOP" in sent


@pytest.mark.parametrize("words", ["CELL PORT", "PORT CELL", "--port PORT", "--port PORT --cell CELL"])
def test_stop_takes_port_and_cell_as_other_verbs_have_them(
    words: str, port: tuple[Emulator, str], tmp_path: Path
) -> None:
    typed = words.replace("PORT", port[1]).replace("CELL", str(CELL))
    said, _ = a465("stop", *typed.split(), cwd=tmp_path)
    assert "STOP was sent; the arm is at rest" in said


def test_what_is_no_mars_gets_no_stop(tmp_path: Path) -> None:
    options = EmulatorOptions(version="LX_RoCoN v1")
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl", options=options) as (_, name):
        _, told = a465("stop", name, code=2, cwd=tmp_path)
    assert "is not MARS8" in told
    assert "press the emergency stop" in told
    assert names_to(tmp_path / "unit.jsonl") == {"ECHO", "STAMP", "VER?"}


def test_a_program_that_does_not_let_go_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.commands.manual.stop, "ENDS_S", 0.3)
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl") as (_, name), _other(DEAF, name) as other:
        _, told = a465("stop", name, code=4, cwd=tmp_path)
    assert f"process {other.pid}" in told
    assert "still has the port after 0.3 s: press the emergency stop if the arm moves" in told
    assert names_to(tmp_path / "unit.jsonl") == set()


def test_a_program_that_only_reads_or_stops_is_waited_for_and_not_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signals: list[object] = []
    monkeypatch.setattr(cell.commands.manual.stop, "ENDS_S", 0.3)
    monkeypatch.setattr(cell.commands.manual.stop, "_signal", lambda *told: signals.append(told))
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl") as (_, name):
        for kind, number in (("brief", 0), ("stop", 0), ("long", 1)):
            with _other(DEAF, kind, name):
                a465("stop", name, code=4, cwd=tmp_path)
            assert len(signals) == number


def test_an_arm_that_does_not_come_to_rest_is_told(
    port: tuple[Emulator, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = cell.commands.manual.stop.bring_to_rest

    def unsure(*arguments: object) -> object:
        from dataclasses import replace

        return replace(plain(*arguments), at_rest=False, note="no answer")  # type: ignore[arg-type]

    monkeypatch.setattr(cell.commands.manual.stop, "bring_to_rest", unsure)
    _, told = a465("stop", port[1], code=4, cwd=tmp_path)
    assert "THE ARM MAY STILL BE MOVING (no answer): press the emergency stop" in told


@pytest.mark.slow
def test_a_command_of_a465_that_moves_the_arm_ends_with_4(port: tuple[Emulator, str], tmp_path: Path) -> None:
    move = "import sys; from cell.cli.start import main; print('begins', flush=True); main()"
    options = ("--turn=80,0,0,0,0,0", "--unseen")
    with _other(move, "move", str(CELL), port[1], *options) as other:
        over = time.monotonic() + 120.0
        while not any(line.startswith("COORDSPLINET") for line in lines_to(tmp_path / "unit.jsonl")[-30:]):
            assert time.monotonic() < over
            assert other.poll() is None
            time.sleep(0.1)
        state = json.loads(a465("status", port[1], "--json", cwd=tmp_path)[0])
        assert state["held_by"]["pid"] == other.pid
        assert state["held_by"]["folder"] == str(tmp_path / "runs/move-1")
        assert state["unit"] == "crs93"
        assert state["q_deg"] is not None
        said, _ = a465("stop", port[1], "--json", cwd=tmp_path)
        assert other.wait(120) == 4
        assert other.stderr is not None
        assert "interrupted" in other.stderr.read()
    told = json.loads(said)
    assert told["moving"] is False
    assert told["interrupted"]["log"] == str(tmp_path / "runs/move-1/wire.jsonl")
