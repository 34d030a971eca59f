"""An emulated unit on a pseudo-terminal, as a command beside the arm finds it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock
from driver.line.wire_log import WireLog
from emulated.stepped_cell import set_homed


@contextmanager
def on_pty(
    unit: Unit,
    log: Path,
    time_scale: float = 10.0,
    options: EmulatorOptions | None = None,
    homed_deg: Sequence[float] | None = None,
) -> Iterator[tuple[Emulator, str]]:
    """Yield the emulator, and the port; `log` gets every line.

    With `homed_deg` the unit was homed before, and has been switched on since; the arm stands there.
    """
    clock, options = Clock(time_scale), options or EmulatorOptions()
    if homed_deg is not None:
        options = replace(options, power_up_deg=tuple(homed_deg))
    with WireLog(log, clock) as wire, Emulator(unit, clock, options=options, log=wire) as emulator:
        if homed_deg is not None:
            set_homed(emulator)
        yield emulator, emulator.open_pty()


def lines_to(log: Path) -> list[str]:
    """Lines that a unit received, in order, without empty ones."""
    records = map(json.loads, log.read_text().splitlines())
    return [r["text"] for r in records if r["kind"] == "line" and r["text"]]


def names_to(log: Path) -> set[str]:
    """Names of the commands that a unit received, and queries with their question mark."""
    return {line.partition(":")[0] for line in lines_to(log)}
