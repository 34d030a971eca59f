"""``a465 emulate``: an emulated controller as a program, alone or in the simulated cell of a task.

Modules of the cell are imported only if a task is given, so that the controller alone starts fast.
"""

from __future__ import annotations

import os
import queue
import signal
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from arm.controller.unit import Unit, load_unit, unit_called
from arm.errors import ExecutionStopped, FileInputError, InputError
from arm.io.outputs import keep_apart
from cell.console import say_on_stderr
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.faults.file import read_faults
from driver.line.clock import Clock
from driver.line.signals import SIGNALS
from driver.line.wire_log import WireLog
from driver.log.read import is_log

if TYPE_CHECKING:
    from cell.sim.cell import SimulatedCell

POLL_S = 0.1  # wall time
BAD = ("pushed", "missed", "fallen")  # events that a correct run does not have


def emulate_step(
    unit_name: str | None = None,
    link: Path | None = None,
    tcp: int | None = None,
    time_scale: float = 1.0,
    fault_file: Path | None = None,
    log_file: Path | None = None,
    task_file: Path | None = None,
    world: Path | None = None,
    photographs: Path | None = None,
    hand_file: Path | None = None,
) -> None:
    """Serve until a signal arrives, then report what happened to the cubes, if any.

    The arguments are the options of the command (`cell.cli.tools.emulate`).

    Raises:
        InputError: unit, link, port, time scale, fault file, log, task, world or folder is wrong; nothing was served.
        ExecutionStopped: the log or the folder cannot be written, or a port that should come back is taken.
    """
    if not 0.01 <= time_scale <= 100.0:
        raise InputError(f"time scale = {time_scale:g}: must be from 0.01 to 100", time_scale=time_scale)
    if link is not None and _is_dead(link):
        link.unlink()  # left by an emulator that was killed
    if link is not None and os.path.lexists(link):
        what = (
            "is the port of a unit or of an emulator that runs" if link.is_char_device() else "exists already"
        )
        raise InputError(f"{link}: {what}; choose another name for the link", link=str(link))
    if tcp is not None and not 0 <= tcp <= 65535:
        raise InputError(f"tcp = {tcp}: must be a port from 0 to 65535", tcp=tcp)
    keep_apart(log_file, fault_file, task_file, world, kind=None)
    if log_file is not None and log_file.is_file() and log_file.stat().st_size and not is_log(log_file):
        why = f"--log {log_file}: is a file, and no wire log, which alone is replaced; choose another name"
        raise InputError(why, option="log", file=str(log_file))
    simulated = _cell(task_file, world, hand_file)
    unit, clock = _unit(unit_name, simulated), Clock(time_scale)
    options = EmulatorOptions(faults=read_faults(fault_file) if fault_file else ())
    # A handler runs between any two steps of this thread. A SimpleQueue's put may do so; an Event's set would wait
    # forever for the lock that its own wait holds.
    signals = queue.SimpleQueue[int]()
    for number in SIGNALS:
        signal.signal(number, lambda number, _: signals.put(number))
    with ExitStack() as stack:
        log = stack.enter_context(WireLog(log_file, clock)) if log_file else None
        emulator = stack.enter_context(Emulator(unit, clock, simulated, options, log))
        camera = None
        if simulated is not None:
            from cell.session.connection import join

            frames = join(simulated, emulator)
            if photographs is not None:
                from cell.sim.photo_folder import FolderCamera

                camera = FolderCamera(simulated, frames, emulator, photographs)
        try:
            linked = f", linked from {link}" if link else ""
            print(f"{unit.name} on {emulator.open_pty(link)}{linked}", flush=True)
            if tcp is not None:
                print(f"{unit.name} on {emulator.open_tcp(tcp)}", flush=True)
        except OSError as error:
            raise InputError(f"emulate: --tcp {tcp}: {error.strerror}", link=str(link), tcp=tcp) from error
        if simulated is not None:
            stack.callback(_print_cubes, simulated)
            print(f"simulated cell: {simulated.world.file}", flush=True)
        if camera is not None:
            print(f"images: {photographs}, written while the arm stands still", flush=True)
        while not _arrived(signals, POLL_S):
            if log is not None:
                log.check()
            if emulator.failure is not None:
                raise ExecutionStopped(f"emulate: {emulator.failure}", reason="port")
            if camera is not None:
                camera.poll()


def _arrived(signals: queue.SimpleQueue[int], within_s: float) -> bool:
    """Whether a signal has arrived, or does so within that wall time."""
    try:
        signals.get(timeout=within_s)
    except queue.Empty:
        return False
    return True


def _is_dead(link: Path) -> bool:
    """Whether a link points to a pseudo-terminal that no longer exists."""
    return link.is_symlink() and os.readlink(link).startswith("/dev/pts/") and not link.exists()


def _cell(task_file: Path | None, world: Path | None, hand_file: Path | None) -> SimulatedCell | None:
    """Return the simulated cell of the task, or None."""
    if task_file is None:
        return None
    from cell.files.task import Task
    from cell.program.program_file import task_of_file
    from cell.session.connection import simulated_cell
    from cell.sim.made import require_boards_of

    task = task_of_file(task_file)
    simulated = simulated_cell(task, world)
    if hand_file is None and isinstance(task, Task):  # worlds for hand-eye have a target in place of boards
        try:
            require_boards_of(task, simulated.world)
        except FileInputError as error:
            say_on_stderr(f"NOTE: {error}")
    if hand_file is not None:
        from cell.files.hand_target import read_hand_target

        simulated.hold(read_hand_target(hand_file))
    return simulated


def _unit(name: str | None, simulated: SimulatedCell | None) -> Unit:
    if simulated is None:
        return load_unit("crs93") if name is None else unit_called(name)
    unit = simulated.cell.nominal_unit
    if name not in (None, unit.name) and unit_called(str(name)).digest != unit.digest:
        raise InputError(f"--unit {name}: the task's cell has {unit.name}; leave out --unit", unit=name)
    return unit


def _print_cubes(simulated: SimulatedCell) -> None:
    """Print the last event of every cube and all events in `BAD`."""
    events = tuple(simulated.events)
    counted = ", ".join(f"{n} {what}" for what, n in Counter(e.what for e in events).items())
    print(f"cubes: {counted or 'none touched'}")
    last = {e.cube: e for e in events}
    for event in events:
        if event.what in BAD or event is last[event.cube]:
            print(event.message)
