"""A whole run in this process, with everything that the simulated cell and the emulated controller know of it."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any
from unittest.mock import patch

import numpy as np

import cell.commands.run
from arm.errors import A465Error
from arm.plan_file import Plan, read_plan
from cell.console import Console
from cell.files.task import Task, read_task
from cell.session.connection import Connection, WhichCell, open_cell
from cell.sim.cell import CellState, SimulatedCell
from driver.emulator import Record


@dataclass
class WholeRun:
    """What a run left behind.

    Attributes:
        report: of the run; empty if it failed.
        error: that ended it, or None.
        said: on the console.
        plans: in order, with the way to the start.
    """

    task: Task
    folder: Path
    report: dict[str, Any] = field(default_factory=dict)
    error: A465Error | None = None
    said: str = ""
    simulated: SimulatedCell | None = None
    record: Record | None = None
    sent: tuple[tuple[int, str], ...] = ()

    def plan(self, name: str = "plan") -> Plan:
        """A plan file of the run."""
        return read_plan(self.folder / f"{name}.json")

    @property
    def history(self) -> list[CellState]:
        """States of cubes and jaws."""
        return [] if self.simulated is None else self.simulated.history


def run_whole(
    task_file: Path,
    folder: Path,
    time_scale: float = 100.0,
    world: Path | None = None,
    meddle: Callable[[Connection], None] | None = None,
    speed: float | None = None,
) -> WholeRun:
    """Run a task; `meddle` may change the simulated cell once it is open."""
    run = WholeRun(read_task(task_file), folder)

    class Watched:
        """Stands in for `open_cell`, to look at the cell before it closes."""

        def __init__(self, task: Task, where: WhichCell, log: Path) -> None:
            self._opened = open_cell(task, where, log)

        def __enter__(self) -> Connection:
            self.connection = self._opened.__enter__()
            run.simulated = self.connection.simulated
            if meddle is not None:
                meddle(self.connection)
            return self.connection

        def __exit__(
            self,
            kind: type[BaseException] | None,
            error: BaseException | None,
            traceback: TracebackType | None,
        ) -> bool | None:
            emulator = self.connection.emulator
            if emulator is not None:
                run.record, run.sent = emulator.record(), emulator.lines
            return self._opened.__exit__(kind, error, traceback)

    output = io.StringIO()
    try:
        with (
            patch.object(cell.commands.run, "open_cell", Watched),
            redirect_stdout(output),
            redirect_stderr(output),
        ):
            run.report = cell.commands.run.run_task(
                task_file, Console(), WhichCell(world=world, speed=speed, time_scale=time_scale), folder
            )
    except A465Error as error:
        run.error = error
    run.said = output.getvalue()
    return run


def executed(run: WholeRun, after_ms: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Times (m,) ms and joint positions (m, 6) rad of every executed millisecond after `after_ms`."""
    if run.record is None:
        raise ValueError("the run has no record")
    keep = run.record.time_ms > after_ms
    return run.record.time_ms[keep], run.task.cell.unit.positions(run.record.counts[keep])


def homed_ms(run: WholeRun) -> int:
    """When the first planned motion was sent: what comes before is homing, which the unit does by itself."""
    return next(time_ms for time_ms, line in run.sent if line.startswith("COORDSPLINET"))
