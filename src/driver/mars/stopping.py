"""Bringing the arm to rest, and saying in which state it then is."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from driver.line.link import ANSWER_S, Link, NoAnswer
from driver.line.protocol import (
    Answer,
    MalformedAnswer,
    Position,
    Reply,
    Status,
    encode_query,
    parse_integer,
    parse_position,
    parse_status,
)
from driver.line.unit_time import SLACK_S

_T = TypeVar("_T")

SAMPLE_S = 0.1  # between two position samples that are compared
STILL_COUNTS = 2  # change of an axis between two samples of an arm at rest
REPEAT_S = 0.05  # between two STOPs,
REPEATS = 30  # so many times; by then an arm has usually run out of motion,
SLOW_REPEAT_S = 0.5  # and more would flood a unit that is slow
LOOK_S = 0.3  # beyond the round trips, for all answers of a look,
LOOK_WALL_S = 0.2  # and no less than this much wall time
SILENT_S = 6.0  # a unit that says nothing for so long is not waited for
SPOILED_LOOKS = 3  # which brought no status
UNECHOED_LOOKS = 20  # that saw the arm at rest, though no STOP came back
STOP_S = 10.0  # the slowest axis brakes from twice its default speed in 0.4 s; the rest is patience


@dataclass(frozen=True)
class RestState:
    """In which state a stop has left the arm.

    Attributes:
        at_rest: seen to stand still after the stop.
        counts: last position known, (6,), or None.
        status: last status known, or None.
        note: why something is not known, or "".
        stops: how often STOP was sent.
    """

    at_rest: bool
    counts: tuple[int, ...] | None
    status: Status | None
    note: str = ""
    stops: int = 0

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
            "stops": self.stops,
        }


def _degrees(unit: Unit, counts: tuple[int, ...]) -> list[float]:
    return [float(q) * 57.29577951308232 for q in unit.positions(counts)]


def read_status(link: Link) -> Status:
    """The status word now. An answer damaged or lost on the line is asked for once more, one that tells of a fault too.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    status = ask_again(link, "ST", parse_status)
    return ask_again(link, "ST", parse_status) if status.fault else status


def read_position(link: Link, axes: int) -> Position:
    """Where the coordinated group is now. Needs the group formed. Asked once more as `read_status`.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
        ExecutionStopped: the unit was switched off and on: it knows of no group any more, or its clock was set anew.
    """
    try:
        position = ask_again(link, "COORDAP", lambda text: parse_position(text, axes))
    except NoAnswer:
        if all(link.ask_optional("COORDAP") is None for _ in range(2)):
            link.restarted = True
            refuse_restarted(link, "position")
        raise
    if link.unit_time.jumped(link.clock.now(), position.time_ms, link.patience(SLACK_S)):
        link.restarted = True
        refuse_restarted(link, "position")
    return position


def refuse_restarted(link: Link, what: str) -> None:
    """Refuse to go on with a unit that was switched off and on.

    Raises:
        ExecutionStopped: with the reason ``restarted``.
    """
    if link.restarted:
        raise ExecutionStopped(
            f"{what}: the unit was switched off and on, so its positions are lost: it must be homed again, which opens "
            "the jaws; take out first what they hold",
            reason="restarted",
        )


def ask_again(link: Link, name: str, parse: Callable[[str], _T], axis: str = "") -> _T:
    """An answer; one that was damaged or lost on the line is asked for once more.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    try:
        return parse(link.ask(name, axis))
    except (NoAnswer, MalformedAnswer):
        link.synchronise()  # a late answer to the first is then no longer on its way
        return parse(link.ask(name, axis))


def farthest(a: tuple[int, ...], b: tuple[int, ...]) -> int:
    """Largest difference of any axis, counts."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _send_stop(link: Link, again: bool) -> None:
    """STOP, whatever interrupts: it counts as sent once it was, and twice does no harm."""
    while True:
        try:
            link.send_stop(again)
        except KeyboardInterrupt:
            continue
        return


def bring_to_rest(link: Link, axes: Sequence[str], timeout: float = STOP_S) -> RestState:
    """Send STOP at once, again and again until it has come back and the arm stands.

    Never raises for anything the link does, nor for a second interrupt: what could not be learnt is in the note.
    The arm stays powered and holds (STOP, never RELEASE: without current it would sag).

    Args:
        axes: of the coordinated group; none if it is not formed yet, then only the status is watched. Where the unit
            does not answer for the group any more (it was switched off and on), each axis is asked.
        timeout: controller seconds until it is told that the arm was not seen to stand.
    """
    stopping = _Stopping(link, axes)
    try:
        _send_stop(link, again=False)
        return stopping.run(timeout)
    except ExecutionStopped as error:  # LinkLost, a log that cannot be written
        return RestState(False, stopping.counts, stopping.status, str(error))
    except KeyboardInterrupt:
        return RestState(
            False, stopping.counts, stopping.status, "interrupted again after STOP was sent", stopping.stops
        )


class _Stopping:
    """One stop. A look is ST, the position, and a stamp; it counts once its stamp is answered, for then its other
    answers are here. STOP has been obeyed when it has come back; where nothing comes back, when the arm stands."""

    def __init__(self, link: Link, axes: Sequence[str]) -> None:
        self.link = link
        self.axes = tuple(axes)
        self.status: Status | None = None
        self.counts: tuple[int, ...] | None = None
        self.stops = 1
        self._heard = False
        self._spoiled = -1  # looks without a status; the first has none before it
        self._asking: deque[str] = deque()  # what is left to ask of the look that runs
        self._fresh: Status | None = None
        self._at: tuple[int, ...] | None = None
        self._of_axis: dict[str, int] = {}
        self._alone = False  # the group does not answer: ask its axes
        self._before: tuple[int, ...] | None = None  # of the look before
        self._still_looks = 0

    def run(self, timeout: float) -> RestState:
        link, now = self.link, self.link.clock.now()
        deadline, silent_at = link.deadline(timeout), link.deadline(SILENT_S)
        repeat_at, look_at, look_s = now + REPEAT_S, now, LOOK_S
        while (now := link.clock.now()) < deadline and (self._heard or now < silent_at):
            if now >= look_at:
                self._begin_look()
                look_at = now + link.clock.at_least(look_s + 4.0 * link.trip_s, LOOK_WALL_S)
                look_s = min(1.5 * look_s, ANSWER_S)  # where nothing is echoed, the round trip is not known
            # answers that never come may have come in the middle of echoes: then ask one thing at a time
            in_turn = link.takes_turns or self._spoiled >= SPOILED_LOOKS
            while self._asking and not link.blocked and not (in_turn and link.echo.unanswered):
                line = self._asking.popleft()
                link.send(line or link.fresh_stamp())
            if now >= repeat_at:
                if not link.blocked:  # else enough of them wait before it
                    _send_stop(link, again=True)
                    self.stops += 1
                repeat_at = now + (REPEAT_S if self.stops < REPEATS else SLOW_REPEAT_S)
            reply = link.receive(min(repeat_at, look_at, deadline))
            if reply == Answer("STAMP", link.stamped.partition(":")[2]) and not self._asking:
                if self._stands():
                    return self._at_rest()
                look_at, look_s = link.clock.now() + SAMPLE_S, look_s / 1.5
            elif reply is not None:
                self._take(reply)
        why = (
            f"still moving or busy {timeout:g} s after STOP"
            if self._heard
            else f"{link.url}: no answer within {SILENT_S:g} s after STOP"
        )
        return RestState(False, self.counts, self.status, why, self.stops)

    def _begin_look(self) -> None:
        self.link.echo.forgive_answers()
        self._spoiled += self._fresh is None
        self._fresh, self._at = None, None
        self._of_axis.clear()
        self._asking = deque([encode_query("ST")])
        if self.axes:
            self._asking.append(encode_query("COORDAP"))
            self._asking.extend(encode_query("AP", axis) for axis in self.axes if self._alone)
        self._asking.append("")  # the stamp

    def _take(self, reply: Reply) -> None:
        try:
            match reply:
                case Answer("ST", text):
                    self._fresh = self.status = parse_status(text)
                case Answer("COORDAP", text):
                    self._at = parse_position(text, len(self.axes)).counts
                case Answer(key, text) if key[:2] == "AP" and key[2:] in self.axes:
                    self._of_axis[key[2:]] = parse_integer(text)
                case _:
                    return
        except MalformedAnswer:
            return  # damaged on the line; the next look counts
        self._heard = True

    def _stands(self) -> bool:
        """Whether this look and the one before saw the arm at rest, and STOP was obeyed."""
        before, at = self._before, self._at
        if at is None and len(self._of_axis) == len(self.axes) > 0:
            at = tuple(self._of_axis[axis] for axis in self.axes)
        self._before = before if at is None else at  # a damaged look is nothing to compare with
        self._alone = bool(self.axes) and self._at is None and self._fresh is not None
        self.counts = at if at is not None else self.counts
        quiet = self._fresh is not None and (not self._fresh.busy or self._fresh.fault)
        compared = not self.axes or (at is not None and before is not None)
        still = at is None or before is None or farthest(before, at) <= STILL_COUNTS
        if (self._fresh is not None and not quiet) or not still:
            self._still_looks = 0  # a look of which something was lost tells nothing, and takes nothing away
        elif quiet and compared:
            self._still_looks += 1
        obeyed = self.link.echo.stops > 0 or not self.link.echoes
        return self._still_looks >= (1 if obeyed else UNECHOED_LOOKS)

    def _at_rest(self) -> RestState:
        link = self.link
        link.events.clear()
        if link.echoes:
            link.echo.resume()  # everything that was sent has been obeyed
        note = "the unit has lost its positions: home it again" if link.restarted else ""
        return RestState(True, self.counts if self.axes else None, self.status, note, self.stops)
