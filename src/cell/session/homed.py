"""Homing: for the first time in a free cell, for nothing checks its way; or not at all, if the unit kept its positions.

With ``--homed`` a unit that is powered, was homed and says where it is stays as it is. What of that the unit can tell
is checked: no fault, counters that are not those of power-up and inside the limits, an arm that stands still. That its
counters are right it cannot tell.
"""

from __future__ import annotations

import os
from urllib.parse import urlsplit

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError
from cell.config.cell import Cell
from cell.console import Console
from cell.session.grasp_monitor import grip_of
from driver.mars.mars import Mars

_HERE = ("localhost", "127.0.0.1", "::1")


def may_be_real(port: str) -> bool:
    """Whether an arm may stand behind a port: any but a pseudo-terminal and this machine's own sockets."""
    if "://" in port:
        return urlsplit(port).hostname not in _HERE
    return not os.path.realpath(port).startswith("/dev/pts/")


def keep_home(mars: Mars, cell: Cell, console: Console, jaws_too: bool = True) -> None:
    """Take an arm into use that was homed before; nothing moves.

    Args:
        mars: of an open cell.
        cell: its file.
        console: where it is told.
        jaws_too: the jaws are to be opened next, so nothing may be in them.

    Raises:
        ImpossibleError: a fault, counters as after power-up or outside the limits, or a cube in the jaws.
        ExecutionStopped: the arm does not stand still.
    """
    mars.initialise(home=False)
    counts = mars.settled_counts()
    width = cell.gripper.width(mars.jaws())
    if jaws_too and not grip_of(cell).why_not(width):
        raise ImpossibleError(
            f"the jaws stand {1e3 * width:.1f} mm apart, as on a cube, and would let go of it where the arm stands: "
            "take it out by hand, or go on with execute --resume",
            width=width,
        )
    degrees = ", ".join(f"{d:.1f}" for d in np.degrees(cell.unit.positions(counts)))
    console.step(
        f"not homed: --homed says that it was, since power-up, and the unit cannot tell; it is powered, without fault, "
        f"and at [{degrees}] deg by its counters: compare with the arm"
    )


def take_into_use(mars: Mars, cell: Cell, console: Console, homed_before: bool) -> None:
    """Home the arm, unless it was and is; open the jaws.

    Raises:
        ImpossibleError: see `keep_home`.
        ExecutionStopped: something failed while homing, or the jaws do not open.
    """
    if homed_before:
        keep_home(mars, cell, console)
    else:
        console.step("homing: the controller moves every axis, nothing checks its way; then the jaws open")
        with console.doing("homing"):
            mars.initialise(home=True, soft_home=False)  # the way from the marks is planned like any other
    mars.set_registers(cell.speed_registers, cell.acceleration_registers)
    if mars.gripper(0.0).stalled:
        where = "where it was" if homed_before else "at its homing marks"
        raise ExecutionStopped(f"the jaws do not open: something blocks them; the arm stands {where}")
    console.step("jaws open" if homed_before else "homed, jaws open")
