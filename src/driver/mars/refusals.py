"""States of a unit in which the arm must not move: faults, lost positions, counts outside the limits."""

from __future__ import annotations

from collections.abc import Sequence

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError
from driver.execution.rest import farthest, off_by, refuse_outside
from driver.line.protocol import Status


def refuse_faults(status: Status) -> None:
    """Refuse a status with a fault.

    Raises:
        ImpossibleError: with the faults and how to clear them.
    """
    if status.fault:
        why = f"{' and '.join(status.faults())}: {status.remedy()}"
        raise ImpossibleError(why, status=status.word, faults=list(status.faults()))


def refuse_unhomed(unit: Unit, counts: Sequence[int]) -> None:
    """Refuse positions that a homed arm cannot have.

    Raises:
        ImpossibleError: half of them close to 0, as after power-up, or one outside the limits.
    """
    if is_unhomed(unit, counts):
        why = f"positions are {list(counts)}, as after power-up or an interrupted homing: the unit must be homed"
        raise ImpossibleError(why, counts=list(counts))
    refuse_outside(unit, counts, "the arm is at")


def is_unhomed(unit: Unit, counts: Sequence[int]) -> bool:
    """Whether half of the counters are close to 0, as after power-up, or while one group after the other is homed.

    Where an axis is homed, its counter is 0 too; a homed arm leaves the marks with all axes.
    """
    return 2 * sum(abs(c) <= unit.rest_tolerance for c in counts) >= len(counts)


def refuse_displaced(unit: Unit, here: tuple[int, ...], expected: tuple[int, ...], held: int = 0) -> None:
    """Refuse to start away from the end of the last motion.

    Args:
        unit: whose counts these are.
        here, expected: where the arm is, and should be.
        held: how many counts beyond `Unit.rest_tolerance` contact may hold an axis off its target.

    Raises:
        ExecutionStopped: with the counts and the axes that are off.
    """
    if farthest(here, expected) > unit.rest_tolerance + held:
        why = (
            f"the arm is {farthest(here, expected)} counts from where the last motion ended "
            f"({off_by(unit, here, expected)}); was it pushed, or the unit switched off? Initialise it again"
        )
        raise ExecutionStopped(why, counts=list(here), expected=list(expected), reason="displaced")
