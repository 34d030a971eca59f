"""``a465 record`` as a person beside an unknown unit has it."""

from __future__ import annotations

import getpass
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import driver.record.take
from arm.controller.unit import load_unit
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.line.clock import Clock
from driver.record.unit_record import Ended, read_unit_record
from emulated.on_pty import lines_to, on_pty
from typed.command_line import a465

SCALE = 5.0  # of the unit's time and of the recording's
QUESTIONS = re.compile(r"ECHO:[01]|STAMP:\d+|[A-Z][A-Z0-9]*\?|help")


@pytest.fixture(autouse=True)
def fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(driver.record.take, "Clock", lambda: Clock(SCALE))


@contextmanager
def a_unit(folder: Path, options: EmulatorOptions | None = None) -> Iterator[tuple[Emulator, str]]:
    with on_pty(load_unit("crs93"), folder / "unit.jsonl", SCALE, options) as served:
        yield served


@pytest.mark.slow
def test_a_unit_as_assumed_is_recorded_and_compared(tmp_path: Path) -> None:
    with a_unit(tmp_path) as (emulator, port):
        said, _ = a465("record", port, "-o", "seen/unit.json", "--seconds", "2", cwd=tmp_path)
        assert emulator.violations == ()
        assert emulator.machine.group == ()
    assert [line for line in lines_to(tmp_path / "unit.jsonl") if not QUESTIONS.fullmatch(line)] == []
    assert "only questions were sent" in said
    assert "20 yes, 0 NO, 0 not known" in said
    assert re.search(r"^name +VER begins with MARS8 +'MARS8 v1\.0", said, re.M)
    file = tmp_path / "seen/unit.json"
    assert read_unit_record(file).ended == Ended.COMPLETE
    again, _ = a465("record", "--compare", file, cwd=tmp_path)
    assert again.splitlines()[1:] == said.splitlines()[-len(again.splitlines()) + 1 :]
    report = json.loads(a465("record", "--compare", file, "--json", cwd=tmp_path)[0])
    assert (report["differing"], report["not_known"], report["ended"]) == ([], [], "complete")
    assert len(report["assumptions"]) == 20


@pytest.mark.slow
def test_the_file_names_neither_host_nor_device_nor_person(tmp_path: Path) -> None:
    with a_unit(tmp_path) as (emulator, _):
        url = emulator.open_tcp()
        a465("record", url, "-o", "unit.json", "--seconds", "1", cwd=tmp_path)
    text = (tmp_path / "unit.json").read_text()
    port = (
        rf"(?<![0-9.]){url.rpartition(':')[2]}(?![0-9])"  # some count or time may have the same digits in it
    )
    assert re.search(port, text) is None
    names = (url, "127.0.0.1", "socket", "/dev", "pts", str(tmp_path))
    person = (socket.gethostname(), getpass.getuser(), str(Path.home()))
    assert [name for name in (*names, *person) if name in text] == []


@pytest.mark.slow
def test_what_differs_is_told_with_what_depends_on_it(tmp_path: Path) -> None:
    with a_unit(tmp_path, EmulatorOptions(echo="none")) as (_, port):
        said, told = a465("record", port, "-o", "unit.json", "--seconds", "1", code=3, cwd=tmp_path)
    assert "a465: differs: echo on" in told
    assert "echo on: damaged lines show late; jog is refused" in said
    assert "19 yes, 1 NO, 0 not known" in said
    said, told = a465("record", "--compare", "unit.json", "--json", code=3, cwd=tmp_path)
    assert json.loads(said)["differing"] == ["echo on"]


def test_another_controller_is_wrong_input_and_kept(tmp_path: Path) -> None:
    with a_unit(tmp_path, EmulatorOptions(version="LX_ROCON 2")) as (_, port):
        _, told = a465("record", port, "-o", "unit.json", code=2, cwd=tmp_path)
    assert told.count("\n") == 1
    assert "firmware 'LX_ROCON 2' is not MARS8" in told
    assert "(what came: unit.json)" in told
    assert {line.partition(":")[0] for line in lines_to(tmp_path / "unit.jsonl")} == {"ECHO", "STAMP", "VER?"}
    _, told = a465("record", "--compare", "unit.json", code=3, cwd=tmp_path)
    assert "differs: name; not known: manners, unknown, status" in told


def test_a_unit_that_is_unplugged_ends_in_one_line(tmp_path: Path) -> None:
    fault = Fault("port_gone", When(command="ST", nth=4), back_after_s=0.0)
    with a_unit(tmp_path, EmulatorOptions(faults=(fault,))) as (_, port):
        _, told = a465("record", port, "-o", "unit.json", "--seconds", "60", code=4, cwd=tmp_path)
    assert told.count("\n") == 1
    assert "the link is lost" in told
    assert "(what came: unit.json)" in told
    record = read_unit_record(tmp_path / "unit.json")
    assert record.ended == Ended.LOST
    assert any(event.data == "rest" for event in record.events)


def test_a_port_on_which_nothing_answers_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("driver.line.clock.LEAST_WALL_S", 0.1)
    ours, theirs = os.openpty()
    try:
        _, told = a465("record", os.ttyname(theirs), "-o", "unit.json", code=2, cwd=tmp_path)
    finally:
        os.close(ours)
        os.close(theirs)
    assert told.count("\n") == 1
    assert "nothing comes back; is the controller connected and switched on? (what came: unit.json)" in told
    assert read_unit_record(tmp_path / "unit.json").ended == Ended.SILENT


def test_what_is_there_is_not_replaced_and_what_is_wrong_opens_no_port(tmp_path: Path) -> None:
    file = tmp_path / "unit.json"
    file.write_text("mine")
    with a_unit(tmp_path) as (emulator, port):
        wrong = {
            ("record", port, "-o", file): "exists, and a recording replaces nothing",
            ("record", port): "give -o FILE",
            ("record", port, "-o", "new.json", "--seconds", "0"): "must be from 1 to 3600",
            ("record", port, "-o", "new.json", "--seconds", "nan"): "must be from 1 to 3600",
            ("record", port, "--compare", file): "--compare opens no port",
            ("record", "-o", "new.json", "--compare", file): "cannot be combined with --compare",
            ("record", "--seconds", "3", "--compare", file): "cannot be combined with --compare",
            ("record", "--compare", file): "is not JSON",
            ("record", port, "-o", "new.toml"): "new.toml: must end in .json, as it is the record of a unit",
            ("record", tmp_path / "none", "-o", "new.json"): "is not there",
        }
        for words, rule in wrong.items():
            _, told = a465(*words, code=2, cwd=tmp_path)
            assert rule in told, words
        assert emulator.lines == ()
    assert file.read_text() == "mine"
    assert not (tmp_path / "new.json").exists()


@pytest.mark.slow
def test_an_interrupt_keeps_what_came(tmp_path: Path) -> None:
    with on_pty(load_unit("crs93"), tmp_path / "unit.jsonl", 1.0) as (emulator, port):
        command = [sys.executable, "-m", "a465", "record", port, "-o", "unit.json"]
        running = subprocess.Popen(
            command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        deadline = time.monotonic() + 120.0
        while not any(line == "ST?" for _, line in emulator.lines):
            assert running.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        running.send_signal(signal.SIGINT)
        said, told = running.communicate(timeout=60)
    assert running.returncode == 130
    assert "what came: unit.json" in said
    assert told == "a465: interrupted; no file was left half-written\n"
    record = read_unit_record(tmp_path / "unit.json")
    assert record.ended == Ended.INTERRUPTED
    assert any(event.data == "ST?\n" for event in record.events), "all that came, not what was saved before"
