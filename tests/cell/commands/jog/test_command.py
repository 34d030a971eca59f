"""a465 jog: keys move the arm among walls in stepped time, and a person at a real terminal does."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import cell.commands.jog.command
import cell.commands.manual.session
from arm.errors import ExecutionStopped, InputError
from arm.io.storage import data_file
from cell.commands.jog.command import IDLE_END_S, Choice, choice_of, jog_step
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.scene.build import unseen_scene
from driver.emulator import Emulator
from emulated.jogged import Jogged, jogged_cell
from emulated.on_pty import lines_to, on_pty
from emulated.stepped_cell import names_sent, stepped_cell
from plan.collision.world import World
from typed.command_line import a465
from typed.heard import Heard

CELL = data_file("scenes/cell.toml")
START_DEG = (-57.0, -40.0, -80.0, 0.0, -60.0, 5.0)
LOW_DEG = (-57.0, -55.9, -80.1, 0.0, -44.0, 5.0)  # 28 mm above the table
UP, DOWN = b"\x1b[A", b"\x1b[B"
DEADLINE_S = 120.0
SCALE = 0.5  # emulated seconds per wall second, on both sides: a busy host is soon enough


@pytest.fixture(scope="module")
def here() -> Cell:
    return read_cell(CELL)


@pytest.fixture
def made(here: Cell) -> Iterator[Jogged]:
    with jogged_cell(here, unseen_scene(here), START_DEG, Choice(mm=1.0)) as jogged:
        yield jogged


def _run(made: Jogged) -> None:
    made.keys_session.run()
    made.jog.finish()


def test_a_held_key_goes_on_to_the_clearance_and_no_further(here: Cell) -> None:
    scene = unseen_scene(here)
    with jogged_cell(here, scene, LOW_DEG, Choice(mm=1.0)) as made:
        begin = made.clock.now() + 0.1
        made.press(begin, b"z")
        made.press(made.hold(begin + 0.1, DOWN, 5.0) + 1.0, b"q")
        _run(made)
    world, counts = World(scene.robot_open, scene.present), made.emulator.record().counts
    least = min(float(world.distance(q).value) for q in here.unit.positions(counts[::20]))
    assert here.clearance <= least < here.clearance + 1e-3
    assert "the tool along z, step 1 mm" in made.heard.all
    assert any("z -: stays: " in line and "(required: 10 mm)" in line for line in made.heard.told)
    assert f"{1e3 * made.keys_session.nearest:.1f} mm clear" in made.heard.all
    assert made.emulator.violations == ()


def test_keys_choose_what_moves_and_how_far(here: Cell, made: Jogged) -> None:
    at = made.clock.now() + 0.1
    for data in (b"3", b".", UP, b"6", b",", b",", b"-", b"4", b"q"):
        made.press(at, data)
        at += 0.6
    _run(made)
    turned = np.degrees(here.unit.positions(made.jog.end)) - START_DEG
    np.testing.assert_allclose(turned, [0, 0, 0.2, 0, 0, -0.05], atol=0.002)
    assert made.jog.steps == 2
    assert "J4, step 0.05 deg" in made.heard.all


def test_a_step_that_takes_too_long_is_told(made: Jogged) -> None:
    at = made.clock.now() + 0.1
    for k, data in enumerate((b"2", b"....", UP, b"q")):
        made.press(at + k, data)
    _run(made)
    assert made.jog.steps == 0
    told = "J2 +: stays: this step would take longer than 0.38 s from the key until the arm rests"
    assert told in made.heard.all


@pytest.mark.parametrize(("data", "why"), [(b"\x1b", "stopped by a key"), (b"", "the terminal is gone")])
def test_a_stop_key_and_the_end_of_the_terminal_stop_a_moving_arm(
    made: Jogged, data: bytes, why: str
) -> None:
    begin = made.clock.now() + 0.1
    made.hold(begin, UP, 3.0)
    made.press(begin + 1.5, data)
    with pytest.raises(ExecutionStopped, match=why), made.mars.guarded("again"):
        made.keys_session.run()
    assert made.rests_at() - (begin + 1.5) < 0.1
    assert "STOP" in names_sent(made.emulator)


def test_escape_ends_it_where_the_arm_rests_and_so_does_no_key(made: Jogged) -> None:
    made.press(made.clock.now() + 0.1, b"\x1b")
    _run(made)
    begin = made.clock.now()
    _run(made)
    assert made.clock.now() - begin == pytest.approx(IDLE_END_S, abs=2.0)
    assert "no key for 300 s" in made.heard.all
    assert "STOP" not in names_sent(made.emulator)[-100:]


@pytest.mark.parametrize(
    ("deg", "mm", "told"),
    [
        (2.0, 0.5, "--deg 2: must be from 0.01 to 1 deg"),
        (0.1, float("nan"), "--mm nan: must be from 0.05 to 5 mm"),
    ],
)
def test_a_step_out_of_range_is_refused(deg: float, mm: float, told: str) -> None:
    with pytest.raises(InputError, match=told):
        choice_of(None, deg, mm)


def test_it_tells_what_is_too_near_and_hears_only_what_is_typed_afterwards(
    scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, console, fresh = scenes / "cell.toml", Heard(), list[bool]()
    place.write_text(re.sub(r"(?m)^clearance_mm = 10\b", "clearance_mm = 48", place.read_text()))
    near = read_cell(place)

    @contextmanager
    def gone(_: object, fresh_only: bool) -> Iterator[bool]:
        fresh.append(fresh_only)
        yield False

    monkeypatch.chdir(tmp_path)
    for module in (cell.commands.jog.command, cell.commands.manual.session):
        monkeypatch.setattr(module, "at_terminal", lambda: True)
    monkeypatch.setattr(cell.commands.manual.session, "typed", lambda: near.unit.name)
    monkeypatch.setattr(
        cell.commands.jog.command, "reading_keys", lambda deliver, fresh=False: gone(deliver, fresh)
    )
    with (
        stepped_cell(near, monkeypatch, START_DEG),
        pytest.raises(ExecutionStopped, match="terminal is gone"),
    ):
        jog_step(place, "/dev/mars", None, 0.1, 0.5, console)
    assert "upper_arm comes within 46.6 mm of base (required: 48 mm): first, only steps" in console.all
    assert fresh == [True]


def test_it_needs_a_terminal(tmp_path: Path) -> None:
    _, told = a465("jog", CELL, "/dev/none-such", code=2, cwd=tmp_path)
    assert "jog needs a terminal, whose keys move the arm" in told


# -- at a terminal


class Person:
    """Someone at a terminal of their own, who reads and types."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.read = ""
        self.child, self.master = pty.fork()
        if self.child == 0:
            os.chdir(folder)
            program = (
                "import driver.line.clock as c, cell.session.connection as s, cell.cli.main as m; "
                f"s.Clock = lambda: c.Clock({SCALE}); m.main()"
            )
            os.execv(sys.executable, [sys.executable, "-c", program, *words])

    def until(self, holds: Callable[[], bool]) -> None:
        over = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < over, self.read[-3000:]
            self.look()

    def look(self) -> None:
        if select.select([self.master], [], [], 0.02)[0]:
            try:
                self.read += os.read(self.master, 4096).decode(errors="replace")
            except OSError:  # the program has ended
                time.sleep(0.02)

    def types(self, data: bytes) -> None:
        os.write(self.master, data)

    def ended(self) -> int:
        """Exit code."""
        found: list[int] = []

        def over() -> bool:
            child, status = os.waitpid(self.child, os.WNOHANG)
            found.extend([os.waitstatus_to_exitcode(status)] if child else [])
            return bool(child)

        self.until(over)
        return found[0]


@contextmanager
def _jogging(cell: Cell, folder: Path) -> Iterator[tuple[Person, Emulator]]:
    """A person whose arm is ready for keys."""
    with on_pty(cell.nominal_unit, folder / "unit.jsonl", SCALE, homed_deg=START_DEG) as (emulator, port):
        person = Person(folder, "jog", str(CELL), port)
        person.until(lambda: "type crs93 to let it move:" in person.read)
        assert not {line.partition(":")[0] for line in lines_to(folder / "unit.jsonl")} & {
            "COORDMV",
            "COORDMVT",
        }
        person.types(b"crs93\n")
        person.until(lambda: "J1, step 0.1 deg" in person.read)
        try:
            yield person, emulator
        finally:
            if _alive(person.child):
                os.kill(person.child, signal.SIGKILL)


def _alive(child: int) -> bool:
    try:
        return os.waitpid(child, os.WNOHANG)[0] == 0
    except ChildProcessError:
        return False


def _rest(emulator: Emulator) -> None:
    """Wait until the arm has stood still for as long as a step ends in."""
    until, at = time.monotonic() + 20.0, None
    while (now := emulator.counts()) != at and time.monotonic() < until:
        at = now
        time.sleep(max(2.0 / SCALE, 0.3))


@pytest.mark.slow
def test_a_person_moves_the_arm_step_by_step_and_ends_it(here: Cell, tmp_path: Path) -> None:
    with _jogging(here, tmp_path) as (person, emulator):
        start = np.array(emulator.counts())
        for key in (UP, UP, b"2", DOWN, b"z", UP):
            before = emulator.counts()
            person.types(key)
            if key in (
                UP,
                DOWN,
            ):  # a key that comes while the step before is under way goes on with that step
                person.until(lambda before=before: emulator.counts() != before)
            _rest(emulator)
        person.types(b"q")
        assert person.ended() == 0
        turned = np.degrees(here.unit.positions(emulator.counts()) - here.unit.positions(start))
        assert turned[0] == pytest.approx(0.2, abs=0.01)
        assert emulator.violations == ()
    report = json.loads((tmp_path / "runs/jog-1/report.json").read_text())
    assert any("4 steps" in line for line in report["remarks"])


@pytest.mark.slow
@pytest.mark.parametrize("how", ["escape", "interrupt", "terminal", "killed"])
def test_whatever_ends_it_the_arm_rests(here: Cell, tmp_path: Path, how: str) -> None:
    with _jogging(here, tmp_path) as (person, emulator):
        begin = time.monotonic()
        while time.monotonic() < begin + 1.0 / SCALE:
            person.types(UP)
            time.sleep(0.04 / SCALE)
        match how:
            case "escape":
                person.types(b"\x1b")
            case "interrupt":
                person.types(b"\x03")
            case "terminal":
                os.close(person.master)
            case "killed":
                os.kill(person.child, signal.SIGKILL)
        if how in ("escape", "interrupt"):
            assert person.ended() == 4
            assert "the arm has stopped and is still under power" in person.read
        time.sleep(1.5 / SCALE)
        assert not emulator.machine.path.queue
        stopped = "STOP" in {line.partition(":")[0] for line in lines_to(tmp_path / "unit.jsonl")}
        assert stopped or how == "killed"
