"""Home the arm, which has no collision checks; or skip homing, if the unit kept its positions.

With ``--homed`` nothing moves. The unit must report no fault and an arm at rest. Its counters must be within the
limits, and differ from those after power-up. Nothing can verify that they are correct.
"""

from __future__ import annotations

import os
from urllib.parse import urlsplit

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError
from cell.config.cell import Cell
from cell.console import Console
from cell.session.grasp_monitor import grip_fault
from driver.mars.mars import Mars

_HERE = ("localhost", "127.0.0.1", "::1")


def may_be_real(port: str) -> bool:
    """Whether a port may lead to a real arm: any port but pseudo-terminals and local sockets."""
    if "://" in port:
        return urlsplit(port).hostname not in _HERE
    return not os.path.realpath(port).startswith("/dev/pts/")


def which_arm(port: str) -> str:
    """Name the arm on a port, for a person who lets it move."""
    if may_be_real(port):
        return f"the real arm on {port}"
    return f"the arm on {port} (an emulated one, unless that line leads to a real arm)"


def initialise_without_homing(mars: Mars, cell: Cell, console: Console, jaws_too: bool = True) -> None:
    """Check an arm that was homed before; nothing moves.

    Args:
        mars: of an open cell.
        cell: its file.
        console: for output.
        jaws_too: whether the jaws open next, and so must be empty.

    Raises:
        ImpossibleError: a fault, counters as after power-up or outside the limits, or a cube in the jaws.
        ExecutionStopped: the arm is not at rest.
    """
    mars.initialise(home=False)
    counts = mars.settled_counts()
    width = cell.gripper.width(mars.jaws()) if cell.has_jaws else None
    if jaws_too and width is not None and not grip_fault(cell, width):
        raise ImpossibleError(
            f"the jaws are {1e3 * width:.1f} mm apart, as on a cube, and would drop it where the arm stands: "
            "take it out by hand, or continue with execute --resume",
            width=width,
        )
    degrees = ", ".join(f"{d:.1f}" for d in np.degrees(cell.unit.positions(counts)))
    console.step(
        "not homed again: that the unit was homed since it was switched on cannot be verified; it is "
        f"powered, without fault, and at [{degrees}] deg by its counters: compare with the arm"
    )


def home_or_check(
    mars: Mars, cell: Cell, console: Console, homed_before: bool, jaws_too: bool = True
) -> None:
    """Home the arm, or check it if it was homed before, and set its registers; the jaws open next if `jaws_too`.

    Raises:
        ImpossibleError, ExecutionStopped: see `initialise_without_homing`; homing failed.
    """
    if homed_before:
        initialise_without_homing(mars, cell, console, jaws_too)
    else:
        still = "the jaws do not move, so the plate must be firm in the gripper"
        jaws = "; then the jaws open" if jaws_too else f"; {still}"
        words = "homing: the controller moves every axis, without collision checks"
        console.step(words + (jaws if cell.has_jaws else ""))
        with console.doing("homing"):
            mars.initialise(home=True, soft_home=False)  # the motion from the marks is planned like any other
    mars.set_registers(cell.speed_registers, cell.acceleration_registers)


def initialise_arm(mars: Mars, cell: Cell, console: Console, homed_before: bool) -> None:
    """Home the arm, unless it was homed before; open the jaws, if it has any.

    Raises:
        ImpossibleError: see `initialise_without_homing`.
        ExecutionStopped: homing failed, or the jaws do not open.
    """
    home_or_check(mars, cell, console, homed_before)
    if not cell.has_jaws:
        if not homed_before:
            console.step("homed")
        return
    if mars.gripper(0.0).stalled:
        where = "where it was" if homed_before else "at its homing marks"
        raise ExecutionStopped(f"the jaws do not open: something blocks them; the arm stands {where}")
    console.step("jaws open" if homed_before else "homed, jaws open")
