"""``a465 release``: switch the motors off, so that the brakes hold the arm, which may drop a little."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm.errors import ExecutionStopped
from cell.commands.manual.reading import Reading, print_reading, read_arm
from cell.commands.manual.session import SUPPORTED, require_consent, require_person
from cell.console import Console
from cell.doctor.devices import FIRMWARE
from cell.report.run_folder import LOG, run_folder
from cell.session.ports import PortAndPlace, choose_port
from driver.line.clock import Clock
from driver.line.protocol import encode
from driver.line.signals import interruptible
from driver.line.wire_log import WireLog
from driver.mars.identity import identified

WORD = "release"
WARNING = (
    "RELEASE switches the motors off. The brakes engage, and THE ARM MAY DROP a little, with what the jaws hold: do "
    "not do this above something that it could hit. The jaws lose their current too, and may let go. Positions are "
    "kept; the next motion switches the motors on again"
)


def release_step(given: PortAndPlace, supported: bool, console: Console) -> dict[str, Any]:
    """Switch the motors of a resting arm off once a person has agreed; return where it was and is.

    Args:
        given: port of the controller, or a cell file that names it.
        supported: the command line states that the arm is supported or may sink.
        console: output.

    Raises:
        InputError: the port is wrong, or nobody agreed; nothing was released.
        ExecutionStopped: the arm moves, or the unit does not answer.
    """
    require_person(supported, SUPPORTED, "that the arm may drop", given.port)
    port = choose_port(given.port, given.place, console)
    clock = Clock()
    with (
        interruptible(ends=True),
        run_folder(None, WORD) as folder,
        WireLog(folder / LOG, clock) as log,
        identified(port, FIRMWARE, clock, log) as (link, _),
    ):
        before = read_arm(link)
        state = before.to_json()
        print_reading(state, console)
        if state["moving"]:
            raise ExecutionStopped(
                f"the arm moves, so it is not released: a465 stop {port} stops it", **state
            )
        console.say(WARNING)
        require_consent(supported, SUPPORTED, console, f"type {WORD} to switch the motors off:", WORD)
        now = read_arm(link).to_json()  # minutes may have passed
        if now["moving"]:
            raise ExecutionStopped(
                f"the arm moves now, so it is not released: a465 stop {port} stops it", **now
            )
        link.send(encode("RELEASE"))
        link.synchronise()
        after = read_arm(link)
    console.step(f"RELEASE was sent; {_sunk(before, after)}")
    return {"released": True, "before": state, "folder": str(folder), **after.to_json()}


def _sunk(before: Reading, after: Reading) -> str:
    """How far the joints have turned, in words."""
    if before.counts is None or after.counts is None:
        return "its position is not known"
    if before.unit is None:
        most = max(abs(a - b) for a, b in zip(after.counts, before.counts, strict=True))
        return f"the axes have turned by at most {most} counts"
    turned = before.unit.positions(after.counts) - before.unit.positions(before.counts)
    return f"the joints have turned by at most {np.degrees(np.abs(turned).max()):.2f} deg"
