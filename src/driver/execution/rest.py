"""An arm at rest: its state after a stop, how far it is from where it should be, and where it must not be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, NoAnswer
from driver.line.clock import Clock

SAMPLE_S = 0.1  # between two position samples that are compared
STILL_COUNTS = 2  # largest change of an axis between two samples of an arm at rest
SETTLE_S = 3.0  # time limit for the arm to settle


class UnitStatus(Protocol):
    """What a unit tells of itself besides positions."""

    @property
    def word(self) -> int:
        """The unit's own number for it, for logs."""
        ...

    @property
    def fault(self) -> bool:
        """Whether anything forbids motion."""
        ...

    def faults(self) -> tuple[str, ...]:
        """Name the faults; empty if there is none."""
        ...


@dataclass(frozen=True)
class RestState:
    """State of the arm after a stop.

    Attributes:
        at_rest: whether the arm was observed at rest after the stop.
        counts: last known position, (n,), or None.
        status: last known status, or None.
        note: why something is not known, or "".
        stops: how often STOP was sent.
    """

    at_rest: bool
    counts: tuple[int, ...] | None
    status: UnitStatus | None = None
    note: str = ""
    stops: int = 0

    def describe(self, unit: Unit) -> str:
        """Describe the state in one phrase for the operator."""
        if not self.at_rest:
            return f"THE ARM MAY STILL BE MOVING ({self.note}): stay out of the cell until you see it has stopped"
        parts = ["the arm has stopped and is still under power"]
        if self.status is not None and self.status.fault:
            parts = [f"the arm has stopped ({', '.join(self.status.faults())})"]
        elif self.note:  # after a power cycle the brakes may hold the arm instead of the motors
            parts = ["the arm has stopped"]
        if self.note:
            parts.append(self.note)
        elif self.counts is not None:
            degrees = ", ".join(f"{d:.2f}" for d in np.degrees(unit.positions(self.counts)))
            parts.append(f"at [{degrees}] deg")
        return ", ".join(parts)

    def noted(self, note: str) -> RestState:
        """Return this state with a note, if it is one of rest that has none."""
        return replace(self, note=note) if note and self.at_rest and not self.note else self

    def error(self, text: str, unit: Unit, /, **data: Any) -> ExecutionStopped:
        """Return the error of an execution that ended in this state: `text`, then the state in words."""
        return ExecutionStopped(f"{text}; {self.describe(unit)}", **{**data, "state": self.to_json()})

    def to_json(self) -> dict[str, Any]:
        """Return the state as JSON types, for error data and logs."""
        return {
            "at_rest": self.at_rest,
            "counts": list(self.counts) if self.counts is not None else None,
            "status": self.status.word if self.status is not None else None,
            "faults": list(self.status.faults()) if self.status is not None else None,
            "note": self.note,
            "stops": self.stops,
        }


def wait_settled(
    clock: Clock, wait: Callable[[float], None], read: Callable[[], tuple[int, ...]]
) -> tuple[int, ...]:
    """Wait until two samples SAMPLE_S apart differ by at most STILL_COUNTS on every axis. Return the counts.

    Args:
        clock: controller time.
        wait: waits for so many controller seconds.
        read: returns the present counts.

    Raises:
        NoAnswer: still moving after SETTLE_S.
    """
    last = read()
    deadline = clock.now() + clock.patience(SETTLE_S)
    while clock.now() < deadline:
        wait(SAMPLE_S)
        now = read()
        if farthest(last, now) <= STILL_COUNTS:
            return now
        last = now
    raise NoAnswer(f"the arm does not settle within {SETTLE_S:g} s", counts=list(last), reason="settle")


def farthest(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    """Return the largest difference of any axis, counts."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def off_by(unit: Unit, here: Sequence[int], there: Sequence[int]) -> str:
    """Describe each axis that is further from its expected position than the unit's rest tolerance."""
    off_deg = np.degrees(unit.positions(here) - unit.positions(there))
    return ", ".join(
        f"{axis} reads {h}, {h - t:+d} ({degrees:+.2f} deg)"
        for axis, h, t, degrees in zip(unit.axes, here, there, off_deg, strict=True)
        if abs(h - t) > unit.rest_tolerance
    )


def refuse_outside(unit: Unit, counts: Sequence[int], what: str) -> None:
    """Refuse counts outside the unit's joint limits. `what` begins the message.

    Raises:
        ImpossibleError: with the axis and the excess in rad.
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


def refuse_not_arrived(unit: Unit, end: tuple[int, ...], goal: tuple[int, ...], held_back: int = 0) -> None:
    """Refuse a motion that has ended away from its target, by more than contact may hold it back, in counts.

    Raises:
        ExecutionStopped: with the counts and the axes that are off.
    """
    if farthest(end, goal) > unit.rest_tolerance + held_back:
        why = (
            f"the arm settled {farthest(end, goal)} counts from the target, must be at most "
            f"{unit.rest_tolerance + held_back} (rest_tolerance_counts): {off_by(unit, end, goal)}"
        )
        raise ExecutionStopped(why, counts=list(end), target=list(goal), reason="position")


def refuse_path_outside(unit: Unit, path: CountPath) -> None:
    """Refuse a path that leaves the unit's joint limits, at or between its points.

    Raises:
        ImpossibleError: as `refuse_outside`.
    """
    for corner in path.extremes():
        refuse_outside(unit, corner.tolist(), "the path reaches")


def refuse_elsewhere(unit: Unit, here: tuple[int, ...], start: tuple[int, ...], held: int = 0) -> None:
    """Refuse a path that does not start where the arm is, within `Unit.rest_tolerance`.

    Args:
        unit: whose counts these are.
        here, start: where the arm is, and the path starts.
        held: how many counts beyond the tolerance contact may hold an axis off its target.

    Raises:
        ImpossibleError: with the counts of both.
    """
    allowed = unit.rest_tolerance + held
    if farthest(here, start) > allowed:
        why = f"the path starts {farthest(here, start)} counts from the arm, must be at most {allowed}"
        raise ImpossibleError(why, counts=list(here), start=list(start))
