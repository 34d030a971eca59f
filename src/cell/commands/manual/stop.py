"""``a465 stop``: STOP to the arm on a port, at once and without a question.

If another a465 has the port, it is interrupted as by Ctrl-C, which makes it send STOP, and is waited for. Then this
program opens the port itself, sends STOP again, and reports whether the arm is at rest.
"""

from __future__ import annotations

import os
import select
import signal
import time
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from arm.errors import ExecutionStopped, InputError
from arm.io.claim import Holder
from cell.commands.manual.reading import Reading, print_reading, read_arm
from cell.console import Console
from cell.doctor.devices import FIRMWARE
from cell.session.ports import PortAndPlace, choose_port
from driver.line.port import port_holder
from driver.line.protocol import Status
from driver.line.signals import interruptible
from driver.mars.identity import identified
from driver.mars.stopping import bring_to_rest

ENDS_S = 30.0  # wall time for the other program to stop the arm, write its report and end
POLL_S = 0.05
VERB = "stop"
BUTTON = "press the emergency stop if the arm moves"


def stop_step(given: PortAndPlace, console: Console) -> dict[str, Any]:
    """Stop the arm on a port; return what happened as JSON types.

    Args:
        given: port of the controller, or a cell file, of which nothing but the port is read.
        console: output.

    Raises:
        InputError: the port cannot be opened, another program that is no a465 has it, or no unit answers there.
        ExecutionStopped: the arm may still be moving.
    """
    port = choose_port(given.port, given.place, console)
    with interruptible(ends=True):
        interrupted = _interrupt_holder(port, console)
        try:
            with console.doing("stopping"), identified(port, FIRMWARE) as (link, version):
                rest = bring_to_rest(
                    link, ()
                )  # the group of an earlier program may be gone, so only the status counts
                last = None if rest.status is None else Status(rest.status.word)
                state = read_arm(link).to_json() if rest.at_rest else Reading(last, None).to_json()
        except InputError as error:
            raise InputError(f"{error}; {BUTTON}", **error.data) from error
    if not rest.at_rest or state["moving"]:
        note = rest.note or "its counters change"
        why = f"{port}: STOP was sent, but THE ARM MAY STILL BE MOVING ({note}): {BUTTON}"
        raise ExecutionStopped(why, state=rest.to_json(), **state)
    console.say(f"{port}: STOP was sent; the arm is at rest")
    print_reading(state, console)
    return {
        "port": port,
        "interrupted": None if interrupted is None else asdict(interrupted),
        "version": version,
        "stops": rest.stops,
        **state,
    }


def _interrupt_holder(port: str, console: Console) -> Holder | None:
    """Interrupt the a465 that has the port, if one has, and wait until it lets the port go.

    Raises:
        ExecutionStopped: it does not, or may not be interrupted.
    """
    holder = port_holder(port)
    if holder is None:
        return None
    handle = None
    with suppress(ProcessLookupError):
        handle = os.pidfd_open(holder.pid)
    try:
        if handle is None or port_holder(port) != holder:  # it has ended meanwhile
            return None
        console.say(f"{port}: waiting for {holder.describe()} to let go; {BUTTON}")
        if not holder.brief and holder.command.split()[1:2] != [VERB]:  # another stop does the same already
            _signal(handle, holder)
        over = time.monotonic() + ENDS_S
        while port_holder(port) == holder:
            if time.monotonic() > over:
                why = f"{port}: {holder.describe()} still has the port after {ENDS_S:g} s: {BUTTON}"
                raise ExecutionStopped(why, holder=asdict(holder), reason="held")
            select.select([handle], [], [], POLL_S)  # readable once the process has ended
            time.sleep(POLL_S)
    finally:
        if handle is not None:
            os.close(handle)
    console.say("it has let the port go")
    return holder


def _signal(handle: int, holder: Holder) -> None:
    """Send what Ctrl-C sends; a process that was stopped by Ctrl-Z continues with it."""
    try:
        signal.pidfd_send_signal(handle, signal.SIGINT)
        signal.pidfd_send_signal(handle, signal.SIGCONT)
    except ProcessLookupError:
        return
    except PermissionError as error:
        why = f"{holder.describe()}: may not be interrupted by this user: {BUTTON}"
        raise ExecutionStopped(why, holder=asdict(holder), reason="held") from error
