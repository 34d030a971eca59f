"""``a465 emulate``: an emulated controller as a program. Imports nothing of the planner, so it starts at once."""

from __future__ import annotations

import os
import signal
import threading
from contextlib import ExitStack
from pathlib import Path

from arm.errors import ExecutionStopped, InputError
from arm.unit import load_unit
from driver.clock import Clock
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.faultfile import read_faults
from driver.wirelog import WireLog


def emulate_step(
    unit_name: str,
    link: Path | None,
    tcp: int | None,
    time_scale: float,
    fault_file: Path | None = None,
    log_file: Path | None = None,
) -> None:
    """Serve until a signal comes.

    Raises:
        InputError: unit, link, port, time scale, fault file or log is wrong; nothing was served.
        ExecutionStopped: the log cannot be written any more, or a port that was to come back is taken.
    """
    if not 0.01 <= time_scale <= 100.0:
        raise InputError(f"time scale = {time_scale:g}: must be from 0.01 to 100", time_scale=time_scale)
    if link is not None and os.path.lexists(link):
        raise InputError(f"{link}: exists already; give a new name for the link", link=str(link))
    if tcp is not None and not 0 <= tcp <= 65535:
        raise InputError(f"tcp = {tcp}: must be a port from 0 to 65535", tcp=tcp)
    unit, clock = load_unit(unit_name), Clock(time_scale)
    options = EmulatorOptions(faults=read_faults(fault_file) if fault_file else ())
    over = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: over.set())
    with ExitStack() as stack:
        log = stack.enter_context(WireLog(log_file, clock)) if log_file else None
        emulator = stack.enter_context(Emulator(unit, clock, options=options, log=log))
        try:
            linked = f", linked from {link}" if link else ""
            print(f"{unit_name} on {emulator.open_pty(link)}{linked}", flush=True)
            if tcp is not None:
                print(f"{unit_name} on {emulator.open_tcp(tcp)}", flush=True)
        except OSError as error:
            raise InputError(f"emulate: {error.strerror}: {link or tcp}", link=str(link), tcp=tcp) from error
        while not over.wait(0.5):
            if log is not None:
                log.check()
            if emulator.failure is not None:
                raise ExecutionStopped(f"emulate: {emulator.failure}", reason="port")
