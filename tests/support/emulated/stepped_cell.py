"""A cell for the commands beside the arm, in stepped time: each session finds the arm where the last left it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import cell.commands.run
from cell.config.cell import Cell
from cell.session.connection import Connection, NoImages, WhichCell
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.unit.path_generator import PathGenerator
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars


def set_homed(emulator: Emulator) -> None:
    """Make a unit that was just switched on one that was homed before; the arm stays where it is."""
    at = emulator.machine.true_counts()
    emulator.machine.offset = (0,) * len(at)
    push_to(emulator, at)


def push_to(emulator: Emulator, counts: Sequence[int]) -> None:
    """Push a resting arm that was homed to other counts."""
    emulator.machine.path = PathGenerator(tuple(int(c) for c in counts))


@contextmanager
def stepped_cell(
    cell_: Cell,
    monkeypatch: pytest.MonkeyPatch,
    homed_deg: Sequence[float] | None = None,
    options: EmulatorOptions | None = None,
) -> Iterator[Emulator]:
    """Open `cell_` for every command that opens a port; with `homed_deg`, the arm stands there and was homed."""
    options, clock = options or EmulatorOptions(), SteppedClock()
    if homed_deg is not None:
        options = replace(options, power_up_deg=tuple(homed_deg))
    with Emulator(cell_.nominal_unit, clock, options=options) as emulator:
        if homed_deg is not None:
            set_homed(emulator)

        @contextmanager
        def opened(task: Any, where: WhichCell, log: Path) -> Iterator[Connection]:
            assert where.blind
            with WireLog(log, clock) as wire, Mars(emulator.open_line(), task.cell.unit, clock, wire) as mars:
                yield Connection(mars, NoImages(), 1.0)

        monkeypatch.setattr(cell.commands.run, "open_cell", opened)
        monkeypatch.setattr(cell.commands.run, "require_openable", lambda *_: None)
        yield emulator


def names_sent(emulator: Emulator) -> list[str]:
    """Names of the commands that the unit received in order, axis included; queries with their question mark."""
    return [line.partition(":")[0] for _, line in emulator.lines if line]
