"""Bringing the arm to rest, and saying in which state it then is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from arm.errors import ExecutionStopped
from arm.unit import Unit
from driver.link import Link, NoAnswer
from driver.protocol import MalformedAnswer, Position, Status, parse_integer, parse_position, parse_status

_T = TypeVar("_T")

SAMPLE_S = 0.1  # between two position samples that are compared
STILL_COUNTS = 2  # change of an axis between two samples of an arm at rest
STOP_S = 10.0  # the slowest axis brakes from twice its default speed in 0.4 s; the rest is patience


@dataclass(frozen=True)
class RestState:
    """In which state a stop has left the arm.

    Attributes:
        at_rest: seen to stand still after the stop.
        counts: last position known, (6,), or None.
        status: last status known, or None.
        note: why something is not known, or "".
    """

    at_rest: bool
    counts: tuple[int, ...] | None
    status: Status | None
    note: str = ""

    def describe(self, unit: Unit) -> str:
        """One phrase for a person."""
        if not self.at_rest:
            return f"the arm's state is NOT known ({self.note}); do not enter the cell before you see it stand still"
        parts = ["the arm stands still under power"]
        if self.status is not None and self.status.fault:
            parts = [f"the arm stands still ({', '.join(self.status.faults())})"]
        if self.note:
            parts.append(self.note)
        elif self.counts is not None:
            degrees = ", ".join(f"{d:.2f}" for d in _degrees(unit, self.counts))
            parts.append(f"at [{degrees}] deg")
        return ", ".join(parts)

    def to_json(self) -> dict[str, Any]:
        """For error data and logs: JSON types."""
        return {
            "at_rest": self.at_rest,
            "counts": list(self.counts) if self.counts is not None else None,
            "status": self.status.word if self.status is not None else None,
            "faults": list(self.status.faults()) if self.status is not None else None,
            "note": self.note,
        }


def _degrees(unit: Unit, counts: tuple[int, ...]) -> list[float]:
    return [float(q) * 57.29577951308232 for q in unit.positions(counts)]


def read_status(link: Link) -> Status:
    """The status word now. An answer damaged or lost on the line is asked for once more.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    return _ask(link, "ST", parse_status)


def read_position(link: Link, axes: int) -> Position:
    """Where the coordinated group is now. Needs the group formed. Asked once more as `read_status`.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    return _ask(link, "COORDAP", lambda text: parse_position(text, axes))


def _ask(link: Link, name: str, parse: Callable[[str], _T]) -> _T:
    try:
        return parse(link.ask(name))
    except (NoAnswer, MalformedAnswer):
        link.synchronise()  # a late answer to the first is then no longer on its way
        return parse(link.ask(name))


def farthest(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    """Largest difference of any axis, counts."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _counts(link: Link, axes: Sequence[str]) -> tuple[int, ...]:
    """Counts of the group, or of each of its axes where the unit does not answer for the group."""
    text = link.ask_optional("COORDAP")
    if text is not None:
        return parse_position(text, len(axes)).counts
    return tuple(parse_integer(link.ask("AP", axis)) for axis in axes)


def _send_stop(link: Link) -> None:
    """STOP, whatever interrupts: it counts as sent once it was, and twice does no harm."""
    while True:
        try:
            link.send_stop()
        except KeyboardInterrupt:
            continue
        return


def bring_to_rest(link: Link, axes: Sequence[str], timeout: float = STOP_S) -> RestState:
    """Send STOP at once and wait until the arm stands still.

    Never raises for anything the link does, nor for a second interrupt: what could not be learnt is in the note.
    The arm stays powered and holds (STOP, never RELEASE: without current it would sag).

    Args:
        axes: of the coordinated group; none if it is not formed yet, then only the status is watched. Where the unit
            does not answer for the group any more (it was switched off and on), each axis is asked.
        timeout: controller seconds until it is told that the arm was not seen to stand.
    """
    status: Status | None = None
    counts: tuple[int, ...] | None = None
    try:
        _send_stop(link)
        link.synchronise(attempts=3)
        deadline = link.deadline(timeout)
        while link.clock.now() < deadline:
            before = counts
            try:
                status = read_status(link)
                counts = _counts(link, axes) if axes else None
            except MalformedAnswer:
                counts = None  # damaged on the line; the next sample counts
            still = not axes or (
                before is not None and counts is not None and farthest(before, counts) <= STILL_COUNTS
            )
            if status is not None and (not status.busy or status.fault) and still:
                link.events.clear()
                note = "the unit has lost its positions: home it again" if link.restarted else ""
                return RestState(True, counts, status, note)
            link.clock.sleep(SAMPLE_S)
        return RestState(False, counts, status, f"still moving or busy {timeout:g} s after STOP")
    except ExecutionStopped as error:  # NoAnswer, LinkLost, a log that cannot be written
        return RestState(False, counts, status, str(error))
    except KeyboardInterrupt:
        return RestState(False, counts, status, "interrupted again after STOP was sent")
