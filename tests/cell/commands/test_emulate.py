"""``a465 emulate`` as a program: faults from a file, a log, whole tasks over its ports, and mistakes told in a line."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import cell.session.connection
from arm.io.storage import data_file
from cell.commands import emulate as emulating
from cell.commands.run import execute_plan
from cell.commands.steps import look_step, plan_step
from cell.console import Console
from cell.files.task import read_task
from cell.session.connection import WhichCell, simulated_cell
from cell.sim.cell import CellEvent
from driver.line.clock import Clock
from tasks.small import small_scenes
from typed.command_line import a465
from wire.client import Client

COMMAND = [sys.executable, "-c", "from cell.cli.start import main; main()", "emulate"]
TIME_SCALE = 3.0  # a host that pauses for 0.1 s pauses the line for 0.3 s of its time
LONGEST_S = 180.0  # for a program to end, on a busy host


class Program:
    """A running ``a465 emulate``; `urls` are those that it says, `said` what it says in the end."""

    def __init__(self, *arguments: str, count: int = 1) -> None:
        self.process = subprocess.Popen(
            [*COMMAND, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.urls = [self.process.stdout.readline().split()[2].rstrip(",") for _ in range(count)]

    def interrupt(self) -> tuple[int, str]:
        """Exit code and what was said of errors."""
        self.process.send_signal(signal.SIGINT)
        self.said, errors = self.process.communicate(timeout=LONGEST_S)
        return self.process.returncode, errors

    def __enter__(self) -> Program:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate(timeout=LONGEST_S)


def records(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_faults_happen_as_the_file_says_and_everything_is_in_the_log(tmp_path: Path) -> None:
    faults, log, link = tmp_path / "faults.toml", tmp_path / "unit.jsonl", tmp_path / "mars"
    faults.write_text('[[fault]]\nkind = "power_off"\nwhen = { command = "GA", after_ms = 100 }\n')
    arguments = ["--fault", str(faults), "--log", str(log), "--link", str(link), "--tcp", "0"]
    with Program("--unit", "crs97", "--time-scale", "20", *arguments, count=2) as program:
        assert program.urls[1].startswith("socket://127.0.0.1:")
        with Client(str(link)) as client:
            client.send("ECHO:0", "COORDISCONT:5", "GA:90000", "R:")
            assert client.read_until(b"!\r\n") == b"ECHO:0\nFAIL!\r\n"
        with Client(program.urls[1]) as client:
            assert client.ask("ST?") == "ST=65536"
            client.send("GA:1", "STAMP:1")
            client.read_until(b"=1\r\n")
        assert program.interrupt() == (0, "")
    assert not link.is_symlink()
    found = records(log)
    told = [(r["kind"], r.get("text", r.get("fault"))) for r in found if r["kind"] != "open"]
    assert told[:8] == [
        ("line", "ECHO:0"), ("line", "COORDISCONT:5"), ("line", "GA:90000"), ("line", "R:"),
        ("fault", "power_off"), ("answer", "FAIL!"), ("line", "ST?"), ("answer", "ST=65536"),
    ]  # fmt: skip
    assert sorted(told[8:]) == [
        ("answer", "STAMP=1"), ("line", "GA:1"), ("line", "STAMP:1"),
        ("violation", "axis A commanded during a fault"),
    ]  # fmt: skip
    ms = [r["ms"] for r in found if r["kind"] != "open"]
    assert all(isinstance(m, int) for m in ms)
    obeyed = next(r["ms"] for r in found if r.get("text") == "GA:90000")
    assert next(r["ms"] for r in found if r["kind"] == "fault") == obeyed + 100


# All its time goes by in the step that a signal must not interrupt in a way that blocks it.
RESTLESS = """
import os, signal, threading, time
from cell.commands import emulate
emulate.POLL_S = 0.0
for number in range(8):
    threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
    emulate.emulate_step()
"""


@pytest.mark.slow
def test_a_signal_ends_it_whatever_it_interrupts() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", RESTLESS], capture_output=True, text=True, timeout=LONGEST_S
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert len(ended.stdout.splitlines()) == 8


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('[[fault]]\nkind = "flood"\n', "fault[0].kind = 'flood': must be one of power_off"),
        (None, "No such file"),
        ('[[fault]]\nkind = "drift"\naxis = "A"\n', "fault[0].counts_per_s: is missing"),
    ],
)
def test_a_bad_fault_file_is_one_line_and_exit_code_2(tmp_path: Path, content: str | None, told: str) -> None:
    path = tmp_path / "faults.toml"
    if content is not None:
        path.write_text(content)
    said, refusal = a465("emulate", "--fault", path, code=2)
    assert said == ""
    assert str(path) in refusal
    assert told in refusal
    assert len(refusal.strip().splitlines()) == 1


def test_a_log_that_cannot_be_written_is_told_before_anything_is_served(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    log = tmp_path / "file" / "unit.jsonl"
    ended = subprocess.run([*COMMAND, "--log", str(log)], capture_output=True, text=True, timeout=LONGEST_S)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert f"log {log}: cannot be written" in ended.stderr


def test_a_link_to_a_port_that_is_served_is_told(tmp_path: Path) -> None:
    (tmp_path / "mars").symlink_to("/dev/null")
    told = a465("emulate", "--link", tmp_path / "mars", code=2)[1]
    assert "mars: is the port of a unit or of an emulator that runs; choose another name for the link" in told


def test_a_file_that_is_no_wire_log_is_not_replaced_by_one(tmp_path: Path) -> None:
    file = tmp_path / "look.json"
    file.write_text("{}")
    said, error = a465("emulate", "--unit", "crs93", "--log", file, code=2)
    assert said == ""
    assert "look.json: is a file, and no wire log, which alone is replaced" in error
    assert file.read_text() == "{}"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--world", "task2.world.toml"], "--world needs --task"),
        (["--photographs", "shots"], "--photographs needs --task"),
        (["--task", "TASK", "--unit", "crs97"], "--unit crs97: the task's cell has crs93"),
        (["--task", "TASK", "--world", "none.toml"], "none.toml: no such world file"),
        (["--task", "TASK", "--photographs", "TASK"], "task2.toml: cannot be created: File exists"),
    ],
)
def test_a_cell_that_cannot_be_had_is_told_before_anything_is_served(arguments: list[str], told: str) -> None:
    task = str(data_file("scenes/task2.toml"))
    asked = [task if argument == "TASK" else argument for argument in arguments]
    said, error = a465("emulate", *asked, code=2)
    assert said == ""
    assert told in error
    assert len(error.strip().splitlines()) == 1


@pytest.mark.slow
@pytest.mark.xdist_group("rehearsal")
def test_a_whole_task_over_a_port_with_photographs_from_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # The client's clock runs as the unit's, for speed alone: docs/emulator.md has what was seen of plain clients.
    monkeypatch.setattr(cell.session.connection, "Clock", lambda: Clock(TIME_SCALE))
    scenes = small_scenes(tmp_path)
    task, world = scenes / "task2.toml", tmp_path / "elsewhere.toml"
    text = (scenes / "task2.world.toml").read_text().replace('"boards/', '"scenes/boards/')
    world.write_text(text.replace("cubes = [1, 2, 3, 4]", "cubes = [1, 3]"))
    shots, log, plan = tmp_path / "shots", tmp_path / "unit.jsonl", tmp_path / "plan.json"
    console = Console(as_json=True)
    look_step(task, None, world, tmp_path / "look.json", None, console)
    plan_step(task, tmp_path / "look.json", plan, 1.0, console, False)
    asked = ["--task", str(task), "--world", str(world), "--photographs", str(shots), "--log", str(log)]
    with Program(*asked, "--time-scale", f"{TIME_SCALE:g}") as unit:
        report = execute_plan(plan, task, Console(), WhichCell(unit.urls[0], images=shots), tmp_path / "run")
        assert unit.interrupt() == (0, "")
    assert [c["placed"] for c in report["cubes"]] == [True, True]
    assert not report["simulated"]
    assert not report["remarks"]
    looks = [line.split("look ")[1] for line in capsys.readouterr().out.splitlines() if "] look " in line]
    cubes = [(line.split(":")[0], [int(n) for n in re.findall(r"\((\d) cubes", line)]) for line in looks]
    assert cubes == [
        ("before anything moves", [2, 0]), ("from q_start", [2, 0]),
        ("after cube 1", [1, 1]), ("after cube 2", [0, 2]),
    ]  # fmt: skip
    said = unit.said.splitlines()
    assert said[-3] == "cubes: 2 gripped, 2 placed"
    placed = [
        re.match(r"(cube \d) placed: into 03-04/\d, 0\.\d\d mm off its axis", line) for line in said[-2:]
    ]
    assert sorted(match[1] for match in placed if match) == ["cube 1", "cube 2"]
    assert [r for r in records(log) if r["kind"] == "violation"] == []
    assert len(list(shots.iterdir())) in (2, 4, 6)


def test_a_world_of_another_task_is_a_note(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    task, world = data_file("scenes/task2.toml"), data_file("scenes/task1.world.toml")
    assert emulating._cell(task, world, None) is not None
    told = capsys.readouterr().err
    assert told.startswith(f"NOTE: {world}: boards: have no board 03-04, which {task} needs")
    assert emulating._cell(task, None, None) is not None
    assert capsys.readouterr().err == ""


def test_what_happened_to_cubes_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    task = read_task(data_file("scenes/task2.toml"))
    simulated = simulated_cell(task, None)
    emulating._print_cubes(simulated)
    assert capsys.readouterr().out == "cubes: none touched\n"
    for what, cube in (("gripped", "cube 1"), ("pushed", "cube 2"), ("gripped", "cube 2"), ("missed", "")):
        simulated.events.append(CellEvent(what, cube, None, f"{cube} {what}: so"))
    emulating._print_cubes(simulated)
    assert capsys.readouterr().out.splitlines() == [
        "cubes: 2 gripped, 1 pushed, 1 missed",
        "cube 1 gripped: so", "cube 2 pushed: so", "cube 2 gripped: so", " missed: so",
    ]  # fmt: skip
