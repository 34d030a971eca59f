"""The page follows the arm, whoever moves it; the unit is only asked, and the port is free for others in between."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import InputError
from arm.io.storage import data_file
from cell.commands.viewing.live_arm import view_live_step
from cell.console import Console
from cell.preview.of_place import place_shown, world_of
from driver.emulator import Emulator
from driver.line.clock import Clock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from emulated.on_pty import names_to, on_pty
from pages.live import Reader
from typed.command_line import a465

CELL = data_file("scenes/cell.toml")
QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}
Q = np.radians([0.0, 10.0, -80.0, 0.0, -60.0, 0.0])


class Watching:
    """`view --live` in a thread, and a page that reads it."""

    def __init__(self, port: str, seconds: float) -> None:
        self.told: list[str] = []
        self.result: dict[str, object] = {}
        self.console = Console(True)
        self.console.say = self.told.append  # type: ignore[method-assign]
        self.thread = threading.Thread(target=self._run, args=(port, seconds))
        self.thread.start()
        until = time.monotonic() + 30.0
        while not (url := re.search(r"127\.0\.0\.1:(\d+)", " ".join(self.told))):
            assert time.monotonic() < until
            time.sleep(0.01)
        self.page = Reader(int(url[1]))

    def _run(self, port: str, seconds: float) -> None:
        self.result = view_live_step(CELL, None, None, port, None, seconds, self.console)

    def sample(self) -> dict[str, object]:
        """The next sample."""
        count = len(self.page.samples)
        self.page.until(lambda _: len(self.page.samples) > count)
        return self.page.samples[-1]


@pytest.fixture
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def port(unit: Unit, tmp_path: Path) -> Iterator[tuple[Emulator, str]]:
    """A homed arm."""
    with on_pty(unit, tmp_path / "unit.jsonl", homed_deg=np.degrees(Q)) as served:
        yield served


@pytest.mark.slow
def test_the_page_has_the_arm_where_the_unit_reports_it(
    port: tuple[Emulator, str], unit: Unit, tmp_path: Path
) -> None:
    watching = Watching(port[1], 6.0)
    sample = watching.sample()
    assert sample["counts"] == unit.counts(Q).tolist()
    closest = world_of(place_shown(CELL, None).setting).distance(Q)
    assert f"{closest.pair[0]} - {closest.pair[1]}: {1e3 * closest.value:.1f} mm" in str(sample["facts"])
    port[0].set_motion_stop(True)
    watching.page.until(lambda _: "motion stop PRESSED" in watching.page.samples[-1]["facts"])
    port[0].set_motion_stop(False)
    said, _ = a465("status", port[1], cwd=tmp_path)  # waits for its turn
    assert "at rest" in said
    watching.thread.join(30.0)
    assert int(str(watching.result["readings"])) >= 3
    assert names_to(tmp_path / "unit.jsonl") <= QUERIES


@pytest.mark.slow
def test_while_another_has_the_port_its_log_is_followed(
    port: tuple[Emulator, str], unit: Unit, tmp_path: Path
) -> None:
    emulator, name = port
    clock = Clock(10.0)
    watching = Watching(name, 8.0)
    watching.sample()
    with WireLog(tmp_path / "work-1/wire.jsonl", clock) as wire, Mars(name, unit, clock, wire) as mars:
        mars.identify()
        mars.initialise(home=False)
        mars.note("step", index=3, name="cube 1: approach")
        at, heard = mars.counts(), len(emulator.lines)
        watching.page.until(lambda _: "cube 1: approach" in watching.page.samples[-1]["facts"])
        sample = watching.sample()
        assert emulator.lines[heard:] == (), "the unit was not asked"
    assert sample["counts"] == list(at)
    watching.page.until(lambda _: "approach" not in watching.page.samples[-1]["facts"])
    watching.thread.join(30.0)


@pytest.mark.slow
def test_an_arm_that_was_not_homed_is_nowhere(unit: Unit, tmp_path: Path) -> None:
    with on_pty(unit, tmp_path / "unit.jsonl") as (_, name):
        watching = Watching(name, 3.0)
        sample = watching.sample()
        assert sample["counts"] is None
        assert "NOT HOMED" in str(sample["facts"])
        watching.thread.join(30.0)


@pytest.mark.parametrize("seconds", [0.0, -1.0, np.inf, np.nan])
def test_a_wrong_time_is_refused(seconds: float) -> None:
    with pytest.raises(InputError, match=r"--seconds = .*: must be above 0"):
        view_live_step(CELL, None, None, "/dev/none", None, seconds, Console(True))


def test_options_that_do_not_go_together(tmp_path: Path) -> None:
    _, told = a465("view", CELL, "--live", "--q", "0,0,0,0,0,0", code=2, cwd=tmp_path)
    assert "--q cannot be combined with --live" in told
    _, told = a465("view", CELL, "--port", "/dev/none", code=2, cwd=tmp_path)
    assert "--port goes with --live" in told
