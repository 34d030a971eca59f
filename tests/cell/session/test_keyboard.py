"""a465 execute with somebody at the keyboard: in a terminal of its own, with the wire log as the witness."""

from __future__ import annotations

import itertools
import json
import os
import pty
import re
import select
import shutil
import signal
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console as Page

from arm.errors import ImpossibleError, InputError
from arm.plan_file import Move, Plan, read_plan
from cell.cli.main import main
from cell.commands.run import execute_plan
from cell.console import Console, progress_bar
from cell.files.task import read_task
from cell.session.connection import WhichCell
from cell.session.keyboard import aborting_keys, hint, on_key, reading_keys
from cell.task.plan_matches import require_start_at
from driver.execution.control import Control

pytestmark = pytest.mark.xdist_group("execute")
DEADLINE_S = 300.0


def _nothing() -> None:
    pass


# -- keys


def test_keys_ask_for_what_they_say() -> None:
    control, aborted = Control(), []
    for key in " ":
        on_key(key, control, _nothing)
    assert control.paused
    assert hint(control, 1.0) == "pausing, then 100 %  space + - q"
    control.standing = True
    on_key("-", control, _nothing)
    assert hint(control, 1.0) == "PAUSED, then 90 %  space + - q"
    on_key("p", control, _nothing)
    assert not control.paused
    assert hint(control, 1.0) == "100 %, next 90 %  space + - q"
    for _ in range(2):
        on_key("-", control, _nothing)
    assert control.override == pytest.approx(0.7)
    assert hint(control) == hint(control, 0.7) == "70 %  space + - q"
    for _ in range(20):
        on_key("-", control, _nothing)
    assert control.override == pytest.approx(0.05)
    for _ in range(20):
        on_key("+", control, _nothing)
    assert control.override == 1.0
    for key in "xyz\n\x00\xff":
        on_key(key, control, lambda: aborted.append(1))
    assert not aborted
    on_key("q", control, lambda: aborted.append(1))
    assert aborted == [1]


def bar(text: str, hint: str, columns: int) -> str:
    """A progress line as a terminal shows it."""
    page = Page(width=columns, color_system=None)
    with page.capture() as drawn:
        page.print(progress_bar(text, 0.5, hint))
    return drawn.get().rstrip()


def test_the_status_line_fits_and_keeps_what_matters() -> None:
    name, keys = "cube 01-02/4: approach 03-04/1", "100 %, next 60 %  space + - q"
    for columns in range(20, 200):
        for text in (name, "move"):
            line = bar(text, keys, columns)
            assert "\n" not in line
            assert len(line) <= columns
            assert columns < 42 or line.endswith(f"  50 %  {keys}")
    assert bar(name, keys, 100).startswith(name + " ")
    assert "━━━" in bar(name, "", 80)
    assert bar("[red]cube\x1b", "", 80).startswith("[red]cube\\x1b "), "as it is written"


def test_plus_never_goes_above_the_speed_that_was_asked_for() -> None:
    control = Control(ceiling=0.45)
    for key in "+-++":
        on_key(key, control, _nothing)
        assert control.override <= 0.45
    assert control.override == 0.45


@pytest.mark.parametrize(
    ("pressed", "aborts"),
    [
        (b" ", True),
        (b"q", True),
        (b"xQ", True),
        (b"\x1b", True),
        (b"\x1b[A", False),
        (b"x+-", False),
        (b"", False),
    ],
)
def test_what_cannot_pause_is_aborted_by_the_keys_that_people_press(
    monkeypatch: pytest.MonkeyPatch, pressed: bytes, aborts: bool
) -> None:
    """Arrow keys are several characters, of which the first is Esc."""
    aborted: list[int] = []

    @contextmanager
    def typed(deliver: Callable[[bytes], None]) -> Iterator[bool]:
        deliver(pressed)
        yield True

    monkeypatch.setattr("cell.session.keyboard.reading_keys", typed)
    monkeypatch.setattr("cell.session.keyboard.interrupt_main", lambda: aborted.append(1))
    with aborting_keys() as keys:
        assert keys
    assert bool(aborted) is aborts


@pytest.mark.parametrize(("fresh", "heard"), [(True, b"x"), (False, b"qx")])
def test_keys_that_were_pressed_before_are_forgotten_where_they_could_move_an_arm(
    monkeypatch: pytest.MonkeyPatch, fresh: bool, heard: bytes
) -> None:
    person, terminal = pty.openpty()
    monkeypatch.setattr("cell.session.keyboard.foreground_terminal", lambda: terminal)
    told: list[bytes] = []
    os.write(person, b"q")
    with reading_keys(told.append, fresh):
        os.write(person, b"x")
        over = time.monotonic() + DEADLINE_S
        while b"x" not in b"".join(told):
            assert time.monotonic() < over, told
            time.sleep(0.01)
    assert b"".join(told) == heard
    os.close(person)
    os.close(terminal)


# -- the program in a terminal


@pytest.fixture(scope="module")
def planned(planned_scenes: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with scenes, and a plan of them."""
    folder = tmp_path_factory.mktemp("planned")
    shutil.copytree(planned_scenes, folder / "scenes")
    shutil.copy(planned_scenes / "plan.json", folder / "plan.json")
    return folder


class Terminal:
    """A child on a terminal of its own.

    Attributes:
        text: all that it wrote.
        code: its exit code, once it has ended.
    """

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.log = folder / "runs/task2-1/wire.jsonl"
        shutil.rmtree(folder / "runs", ignore_errors=True)
        self.text = ""
        self.code: int | None = None
        self.child, self.master = pty.fork()
        if self.child == 0:  # pragma: no cover - the child
            os.chdir(folder)
            sys.argv = ["a465", *arguments]
            code = "import sys, cell.cli.main; cell.cli.main.main()"
            os.execv(sys.executable, [sys.executable, "-c", code, *arguments])
        self.modes = termios.tcgetattr(self.master)

    def until(self, holds: Callable[[], bool], what: str) -> None:
        over = time.monotonic() + DEADLINE_S
        while not holds():
            assert time.monotonic() < over, f"{what} did not come: {self.text}"
            self.read(0.02)

    def read(self, seconds: float) -> None:
        ready, _, _ = select.select([self.master], [], [], seconds)
        if ready:
            try:
                self.text += os.read(self.master, 65536).decode("utf-8", "replace")
            except OSError:
                time.sleep(seconds)
        if self.code is None:
            ended, status = os.waitpid(self.child, os.WNOHANG)
            if ended:
                self.code = os.waitstatus_to_exitcode(status)

    def press(self, keys: str) -> None:
        os.write(self.master, keys.encode())

    def told_after(self, words: str, keys: str) -> bool:
        """Whether such words come soon after keys are pressed."""
        before = len(self.text)
        self.press(keys)
        over = time.monotonic() + 0.3
        while time.monotonic() < over and not re.search(words, self.text[before:]):
            self.read(0.02)
        return re.search(words, self.text[before:]) is not None

    def noted(self, kind: str) -> list[dict[str, object]]:
        if not self.log.is_file():
            return []
        lines = self.log.read_text().splitlines()
        return [r for r in (json.loads(x) for x in lines if x.endswith("}")) if r["kind"] == kind]

    def sent(self) -> str:
        return "".join(str(r["data"]) for r in self.noted("sent"))

    def close(self) -> None:
        if self.code is None:
            os.kill(self.child, signal.SIGKILL)
            os.waitpid(self.child, 0)
        os.close(self.master)


@pytest.fixture
def terminal(planned: Path) -> Iterator[Terminal]:
    run = Terminal(
        planned, "execute", "plan.json", "scenes/task2.toml", "--time-scale", "20", "--speed", "0.4"
    )
    yield run
    run.close()


@pytest.mark.slow
def test_pause_go_on_slower_and_abort_from_the_keyboard(terminal: Terminal) -> None:
    run, keys = terminal, itertools.cycle("-+")
    run.until(lambda: run.sent().count("COORDSPLINET") > 40, "motion")
    run.press(" ")
    run.until(lambda: len(run.noted("standing")) == 1, "standing")
    stood = run.sent().count("COORD")
    time.sleep(0.3)  # 6 s of the controller
    assert run.sent().count("COORDSPLINET") <= stood
    run.until(lambda: "PAUSED, then 80 %  space + - q" in run.text, "the line that says so")
    splines = run.sent().count("COORDSPLINET")
    run.press("--- ")
    run.until(lambda: run.sent().count("COORDSPLINET") > splines + 30, "motion again")
    run.until(lambda: "%  50 %  space + - q" in run.text, "the speed on the line")
    run.until(
        lambda: run.told_after(r"\d %, next \d+ %  space", next(keys)), "another speed asked for in motion"
    )
    run.press("q")
    run.until(lambda: run.code is not None, "the end")
    assert run.code == 4
    assert "interrupted" in run.text
    assert "Traceback" not in run.text
    sent = run.sent()
    assert "COORDSPLINET" not in sent[sent.rindex("STOP:") :]
    assert termios.tcgetattr(run.master) == run.modes
    assert len(run.noted("go_on")) == 1


# -- refusals


def test_a_speed_that_is_not_one_is_refused(planned: Path) -> None:
    for speed in (0.0, 1.5, -1.0):
        with pytest.raises(InputError, match="execution can only lower it"):
            execute_plan(
                planned / "plan.json", planned / "scenes/task2.toml", Console(True), WhichCell(speed=speed)
            )


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda plan: plan["speed_registers"].__setitem__(1, 1024),
            "speed register of axis B 1024, now 2048 (+100.0 %)",
        ),
        (
            lambda plan: plan.__setitem__("unit", "crs97"),
            "is for unit crs97, but task2.toml is of unit crs93",
        ),
        (
            lambda plan: plan["provenance"].__setitem__("calibration", "0" * 64),
            "calibration 000000000000, now",
        ),
    ],
)
def test_a_plan_that_does_not_match_is_refused_before_a_port_is_opened(
    planned: Path,
    change: Callable[[dict[str, object]], None],
    words: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value = json.loads((planned / "plan.json").read_text())
    change(value)
    other = planned / "other.json"
    other.write_text(json.dumps(value))
    shutil.rmtree(planned / "runs", ignore_errors=True)
    monkeypatch.chdir(planned)
    monkeypatch.setattr(sys, "argv", ["a465", "execute", str(other), "scenes/task2.toml"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 3
    assert words in capsys.readouterr().err
    assert not (planned / "runs").exists()


def test_a_plan_from_elsewhere_is_refused_with_the_difference(planned: Path) -> None:
    plan, task = read_plan(planned / "plan.json"), read_task(planned / "scenes/task2.toml")
    require_start_at(task, plan)
    first = next(plan.moves)
    begin = first.path.start
    shifted = replace(first, path=replace(first.path, start=(begin[0] + 1111, *begin[1:])))
    steps = tuple(shifted if isinstance(s, Move) and s is first else s for s in plan.steps)
    other: Plan = replace(plan, steps=steps)
    with pytest.raises(ImpossibleError, match=r"off by A \+1111 counts \(\+1\.00 deg\); plan again"):
        require_start_at(task, other)
