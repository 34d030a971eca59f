"""States of a unit in which nothing is to move: faults, lost positions, counts outside the limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError
from driver.line.protocol import Status
from driver.mars.stopping import farthest


def refuse_faults(status: Status) -> None:
    """Refuse what forbids motion.

    Raises:
        ImpossibleError: with the faults, and what clears them.
    """
    if status.fault:
        raise ImpossibleError(
            f"{' and '.join(status.faults())}: {status.remedy()}",
            status=status.word,
            faults=list(status.faults()),
        )


def refuse_unhomed(unit: Unit, counts: Sequence[int]) -> None:
    """Refuse positions that a homed arm would not tell.

    Raises:
        ImpossibleError: all about 0, as after power-up, or outside the limits.
    """
    if is_unhomed(unit, counts):
        raise ImpossibleError(
            f"positions are {list(counts)}, as after power-up: the unit must be homed", counts=list(counts)
        )
    refuse_outside(unit, counts, "the arm stands at")


def is_unhomed(unit: Unit, counts: Sequence[int]) -> bool:
    """Whether counters stand as after power-up."""
    return max(abs(c) for c in counts) <= unit.rest_tolerance


def off_by(unit: Unit, here: Sequence[int], there: Sequence[int]) -> str:
    """What was read, of each axis that is further from where it should be than the unit's tolerance at rest."""
    off_deg = np.degrees(unit.positions(here) - unit.positions(there))
    return ", ".join(
        f"{axis} reads {h}, {h - t:+d} ({degrees:+.2f} deg)"
        for axis, h, t, degrees in zip(unit.axes, here, there, off_deg, strict=True)
        if abs(h - t) > unit.rest_tolerance
    )


def refuse_displaced(unit: Unit, here: tuple[int, ...], expected: tuple[int, ...]) -> None:
    """Refuse to start from elsewhere than the last motion ended.

    Raises:
        ExecutionStopped: with the counts, and which axes are off.
    """
    if farthest(here, expected) > unit.rest_tolerance:
        raise ExecutionStopped(
            f"the arm is {farthest(here, expected)} counts from where the last motion ended "
            f"({off_by(unit, here, expected)}): was it pushed, or the unit switched off? initialise it again",
            counts=list(here),
            expected=list(expected),
            reason="displaced",
        )


def refuse_not_arrived(unit: Unit, end: tuple[int, ...], goal: tuple[int, ...]) -> None:
    """Refuse an end of a motion that is not its target.

    Raises:
        ExecutionStopped: with the counts, and which axes are off.
    """
    if farthest(end, goal) > unit.rest_tolerance:
        raise ExecutionStopped(
            f"settled {farthest(end, goal)} counts from the target, at most {unit.rest_tolerance} are allowed "
            f"(rest_tolerance_counts): {off_by(unit, end, goal)}",
            counts=list(end),
            target=list(goal),
            reason="position",
        )


def refuse_outside(unit: Unit, counts: Sequence[int], what: str) -> None:
    """Refuse counts outside the unit's joint limits; `what` begins the message.

    Raises:
        ImpossibleError: with axis and excess in rad.
    """
    q = unit.positions(counts)
    rounding = 1.5 / np.abs(unit.counts_per_rad)
    excess = np.maximum(unit.lower - q, q - unit.upper) - rounding
    worst = int(np.argmax(excess))
    if excess[worst] > 0.0:
        low, value, high = np.degrees([unit.lower[worst], q[worst], unit.upper[worst]])
        raise ImpossibleError(
            f"{what} {value:.2f} deg on axis {unit.axes[worst]}: must be from {low:.2f} to {high:.2f} deg",
            axis=unit.axes[worst],
            counts=[int(c) for c in counts],
            excess=float(excess[worst]),
        )
