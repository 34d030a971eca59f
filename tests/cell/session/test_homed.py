"""Homing in a free cell, or not at all: what is asked, what is checked, and what is sent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import cell.session.homed
import cell.task.free_cell
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.io.storage import data_file
from cell.commands.run import run_task
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.session.connection import WhichCell
from cell.session.homed import initialise_arm, initialise_without_homing, may_be_real, which_arm
from driver.emulator import Emulator
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from programs.tool_cells import tool_cell
from wire.lasting_cell import LastingCell


@pytest.mark.parametrize(
    ("port", "real"),
    [
        ("/dev/mars", True),
        ("/dev/ttyUSB0", True),
        ("socket://10.0.0.5:4001", True),
        ("rfc2217://lab:4001", True),
        ("socket://127.0.0.1:4001", False),
        ("socket://localhost:4001", False),
        ("/dev/pts/7", False),
    ],
)
def test_only_what_is_surely_emulated_is_not_asked_about(port: str, real: bool) -> None:
    assert may_be_real(port) is real


def test_a_link_to_a_pseudo_terminal_is_one(tmp_path: Path) -> None:
    (tmp_path / "mars").symlink_to("/dev/pts/7")
    assert not may_be_real(str(tmp_path / "mars"))


@pytest.fixture(scope="module")
def here() -> Cell:
    return read_cell(data_file("scenes/cell.toml"))


@pytest.fixture
def unit(here: Cell) -> Iterator[tuple[Any, Emulator]]:
    """A run on an emulated unit that was switched on and not homed."""
    clock = SteppedClock()
    with Emulator(here.unit, clock) as emulator, Mars(emulator.open_line(), here.unit, clock) as mars:
        mars.identify()
        run = SimpleNamespace(
            connection=SimpleNamespace(mars=mars), task=SimpleNamespace(cell=here), console=Console()
        )
        yield run, emulator


def _homings(emulator: Emulator) -> int:
    return sum(line.startswith("HH") for _, line in emulator.lines)


def test_a_unit_that_was_homed_is_kept_and_told(
    unit: tuple[Any, Emulator], capsys: pytest.CaptureFixture[str]
) -> None:
    run, emulator = unit
    mars = run.connection.mars
    mars.initialise()
    mars.gripper(0.0)
    run.console = Console()
    before, homings = mars.counts(), _homings(emulator)
    initialise_without_homing(run.connection.mars, run.task.cell, run.console)
    assert _homings(emulator) == homings
    assert mars.counts() == before
    told = capsys.readouterr().out
    assert "not homed again: that the unit was homed since it was switched on cannot be verified" in told
    assert "-45.0" in told  # where it stands, to compare


def test_a_unit_as_after_power_up_is_refused_and_one_with_a_cube_in_the_jaws(
    unit: tuple[Any, Emulator], here: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, emulator = unit
    with pytest.raises(ImpossibleError, match=r"must be homed|must be from"):
        initialise_without_homing(run.connection.mars, run.task.cell, run.console)
    assert _homings(emulator) == 0
    mars = run.connection.mars
    mars.initialise()
    monkeypatch.setattr(mars, "jaws", lambda: here.gripper.fraction_closed(here.cube_size))
    with pytest.raises(ImpossibleError, match="as on a cube"):
        initialise_without_homing(run.connection.mars, run.task.cell, run.console)
    initialise_without_homing(
        run.connection.mars, run.task.cell, run.console, jaws_too=False
    )  # a target may be in the hand


@pytest.mark.parametrize(("kept", "stalled"), [(False, False), (False, True), (True, True)])
def test_homing_ends_at_the_marks_and_nothing_goes_on_with_jaws_that_do_not_open(
    monkeypatch: pytest.MonkeyPatch, kept: bool, stalled: bool
) -> None:
    """The way from the marks is planned like any other; nobody goes straight from there."""
    done: list[Any] = []
    mars = SimpleNamespace(
        initialise=lambda **how: done.append(how),
        set_registers=lambda *registers: done.append(registers),
        gripper=lambda closed: SimpleNamespace(stalled=stalled),
    )
    cell_ = SimpleNamespace(speed_registers=(1,) * 6, acceleration_registers=(2,) * 6, has_jaws=True)
    run: Any = SimpleNamespace(
        connection=SimpleNamespace(mars=mars),
        task=SimpleNamespace(cell=cell_),
        console=Console(as_json=True),
        homed_before=kept,
    )
    monkeypatch.setattr(cell.session.homed, "initialise_without_homing", lambda *_: done.append("kept"))
    if stalled:
        with pytest.raises(ExecutionStopped, match="the jaws do not open: .*" + ("was" if kept else "marks")):
            initialise_arm(run.connection.mars, run.task.cell, run.console, run.homed_before)
    else:
        initialise_arm(run.connection.mars, run.task.cell, run.console, run.homed_before)
    assert done == ["kept" if kept else {"home": True, "soft_home": False}, ((1,) * 6, (2,) * 6)]


def test_a_unit_that_was_not_homed_is_refused_before_anything_is_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lasting = LastingCell(tmp_path, monkeypatch, "task2")
    where, folder = WhichCell(lasting.url, homed=True), tmp_path / "run"
    with (
        lasting.emulator,
        pytest.raises(
            ImpossibleError, match="as after power-up or an interrupted homing: the unit must be homed"
        ),
    ):
        run_task(lasting.file, Console(), where, folder)
    assert not list(folder.glob("look-*.png"))
    assert not any(line.startswith(("HH", "REG", "COORD", "SPDT")) for _, line in lasting.emulator.lines)


def test_nothing_is_sent_to_the_jaws_of_an_arm_without_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """But the question whose arm it is, which names each axis that may have a gripper."""
    here, clock = read_cell(tool_cell(tmp_path)), SteppedClock()
    with Emulator(here.unit, clock) as emulator, Mars(emulator.open_line(), here.unit, clock) as mars:
        mars.identify()
        initialise_arm(mars, here, Console(), homed_before=False)
        mars.initialise()
        initialise_arm(mars, here, Console(), homed_before=True)
        axis = here.unit.gripper.axis
        to_jaws = {line for _, line in emulator.lines if line.partition(":")[0].rstrip("?").endswith(axis)}
        assert to_jaws == {f"AP{axis}?"}
        for act in (lambda: mars.gripper(0.0), mars.jaws):
            with pytest.raises(InputError, match="crs93: the arm carries no gripper"):
                act()
    assert "jaws" not in capsys.readouterr().err


def test_an_arm_on_a_line_of_this_machine_is_not_called_real() -> None:
    for port in ("/dev/mars", "socket://unit.lab:4650"):
        assert which_arm(port) == f"the real arm on {port}"
    for port in ("/dev/pts/7", "socket://127.0.0.1:4650"):
        assert which_arm(port) == f"the arm on {port} (an emulated one, unless that line leads to a real arm)"
