"""Bring the arm to rest and report its state."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TypeVar

from arm.errors import ExecutionStopped
from driver.execution.rest import SAMPLE_S, STILL_COUNTS, RestState, farthest
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

REPEAT_S = 0.05  # between the first REPEATS STOPs
REPEATS = 30  # by then, after 1.5 s, the arm has usually stopped
SLOW_REPEAT_S = 0.5  # between further STOPs; more of them would flood a slow unit
POLL_S = 0.3  # time limit for all answers of one poll, beyond the round trips,
POLL_WALL_S = 0.2  # but at least this much wall time
SILENT_S = 6.0  # time without any answer, after which the unit is given up
SPOILED_POLLS = 3  # after this many polls without a status, queries are sent one at a time
UNECHOED_POLLS = 20  # if no STOP is echoed, this many polls must find the arm at rest
STOP_S = 10.0  # time limit, generous: the slowest axis brakes from twice its default speed in 0.4 s


def read_status(link: Link) -> Status:
    """Read the status word. Ask once more if the answer is damaged or lost, or reports a fault.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    status = ask_again(link, "ST", parse_status)
    return ask_again(link, "ST", parse_status) if status.fault else status


def read_position(link: Link, axes: int) -> Position:
    """Read the position of the coordinated group, which must be formed. Ask once more if the answer is damaged or lost.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
        ExecutionStopped: the unit was switched off and on: its group is gone, or its clock was reset.
    """
    asked_s = link.clock.now()
    try:
        position = ask_again(link, "COORDAP", lambda text: parse_position(text, axes))
    except NoAnswer:
        if group_is_gone(link):
            link.restarted = True
            refuse_restarted(link, "position")
        raise
    if link.unit_time.jumped(asked_s, link.clock.now(), position.time_ms, link.patience(SLACK_S)):
        link.restarted = True
        refuse_restarted(link, "position")
    return position


def group_is_gone(link: Link) -> bool:
    """Whether the unit no longer answers for the coordinated group that was formed: it was switched off and on.

    Raises:
        LinkLost.
    """
    return all(link.ask_optional("COORDAP") is None for _ in range(2))


def refuse_restarted(link: Link, what: str) -> None:
    """Refuse to continue with a unit that was switched off and on.

    Raises:
        ExecutionStopped: with the reason ``restarted``.
    """
    if link.restarted:
        raise ExecutionStopped(
            f"{what}: the unit was switched off and on and has lost its positions; take out what the jaws hold, then "
            "home it again (homing opens the jaws)",
            reason="restarted",
        )


def ask_again(link: Link, name: str, parse: Callable[[str], _T], axis: str = "") -> _T:
    """Ask and return the parsed answer. Ask once more if it is damaged or lost on the line.

    Raises:
        NoAnswer, LinkLost, MalformedAnswer.
    """
    try:
        return parse(link.ask(name, axis))
    except (NoAnswer, MalformedAnswer):
        link.synchronise()  # after this no late answer to the first query can come
        return parse(link.ask(name, axis))


def _send_stop(link: Link, again: bool) -> None:
    """Send STOP, and send it again if an interrupt cuts it off: twice does no harm."""
    while True:
        try:
            link.send_stop(again)
        except KeyboardInterrupt:
            continue
        return


def bring_to_rest(link: Link, axes: Sequence[str]) -> RestState:
    """Send STOP at once, and repeat it until it is echoed and the arm is at rest.

    Never raises for a failing link nor for a second interrupt: the note says what is not known. The arm stays powered
    and holds its position (STOP, never RELEASE: without current it would sag).

    Args:
        axes: of the coordinated group. Empty if the group is not formed yet: then only the status is watched. If the
            unit no longer answers for the group (it was switched off and on), each axis is asked.
    """
    stopping = _Stopping(link, axes)
    try:
        _send_stop(link, again=False)
        return stopping.run()
    except ExecutionStopped as error:  # LinkLost, a log that cannot be written
        return RestState(False, stopping.counts, stopping.status, str(error))
    except KeyboardInterrupt:
        return RestState(
            False, stopping.counts, stopping.status, "interrupted again after STOP was sent", stopping.stops
        )


class _Stopping:
    """One stop. A poll asks for ST, the position and a stamp. Answers come in order, so the stamp's answer completes
    the poll. STOP counts as executed once its echo has come, or without echoes once the arm is at rest."""

    def __init__(self, link: Link, axes: Sequence[str]) -> None:
        self.link = link
        self.axes = tuple(axes)
        self.status: Status | None = None
        self.counts: tuple[int, ...] | None = None
        self.stops = 1
        self._heard = False
        self._missed = -1  # polls without a status; -1 because the first has no predecessor
        self._unsent: deque[str] = deque()  # queries of the present poll that are not sent yet
        self._fresh: Status | None = None
        self._at: tuple[int, ...] | None = None
        self._axis_counts: dict[str, int] = {}
        self._by_axis = False  # the group does not answer: ask each axis
        self._before: tuple[int, ...] | None = None  # position of the previous poll
        self._rest_polls = 0

    def run(self) -> RestState:
        link, now = self.link, self.link.clock.now()
        deadline, silent_at = link.deadline(STOP_S), link.deadline(SILENT_S)
        repeat_at, poll_at, poll_s = now + REPEAT_S, now, POLL_S
        while (now := link.clock.now()) < deadline and (self._heard or now < silent_at):
            if now >= poll_at:
                self._begin_poll()
                poll_at = now + link.clock.at_least(poll_s + 4.0 * link.trip_s, POLL_WALL_S)
                poll_s = min(1.5 * poll_s, ANSWER_S)  # without an echo the round trip is not known
            # missing answers may have been mixed into echoes: then ask one thing at a time
            in_turn = link.takes_turns or self._missed >= SPOILED_POLLS
            while self._unsent and not link.blocked and not (in_turn and link.echo.unanswered):
                line = self._unsent.popleft()
                link.send(line or link.fresh_stamp())
            if now >= repeat_at:
                if not link.blocked:  # else enough STOPs are waiting to be sent
                    _send_stop(link, again=True)
                    self.stops += 1
                repeat_at = now + (REPEAT_S if self.stops < REPEATS else SLOW_REPEAT_S)
            reply = link.receive(min(repeat_at, poll_at, deadline))
            if reply == Answer("STAMP", link.stamped.partition(":")[2]) and not self._unsent:
                if self._found_at_rest():
                    return self._at_rest()
                poll_at, poll_s = link.clock.now() + SAMPLE_S, poll_s / 1.5
            elif reply is not None:
                self._take(reply)
        why = (
            f"still moving or busy {STOP_S:g} s after STOP"
            if self._heard
            else f"{link.url}: no answer within {SILENT_S:g} s after STOP"
        )
        return RestState(False, self.counts, self.status, why, self.stops)

    def _begin_poll(self) -> None:
        self.link.echo.forgive_answers()
        self._missed += self._fresh is None
        self._fresh, self._at = None, None
        self._axis_counts.clear()
        self._unsent = deque([encode_query("ST")])
        if self.axes:
            self._unsent.append(encode_query("COORDAP"))
            self._unsent.extend(encode_query("AP", axis) for axis in self.axes if self._by_axis)
        self._unsent.append("")  # the stamp

    def _take(self, reply: Reply) -> None:
        try:
            match reply:
                case Answer("ST", text):
                    self._fresh = self.status = parse_status(text)
                case Answer("COORDAP", text):
                    self._at = parse_position(text, len(self.axes)).counts
                case Answer(key, text) if key[:2] == "AP" and key[2:] in self.axes:
                    self._axis_counts[key[2:]] = parse_integer(text)
                case _:
                    return
        except MalformedAnswer:
            return  # damaged on the line; the next poll counts
        self._heard = True

    def _found_at_rest(self) -> bool:
        """Whether this poll and the one before found the arm at rest, and STOP was executed."""
        before, at = self._before, self._at
        if at is None and len(self._axis_counts) == len(self.axes) > 0:
            at = tuple(self._axis_counts[axis] for axis in self.axes)
        self._before = before if at is None else at
        self._by_axis = bool(self.axes) and self._at is None and self._fresh is not None
        self.counts = at if at is not None else self.counts
        quiet = self._fresh is not None and (not self._fresh.busy or self._fresh.fault)
        compared = not self.axes or (at is not None and before is not None)
        still = at is None or before is None or farthest(before, at) <= STILL_COUNTS
        if (self._fresh is not None and not quiet) or not still:
            self._rest_polls = 0  # an incomplete poll neither counts nor resets the count
        elif quiet and compared:
            self._rest_polls += 1
        executed = self.link.echo.stops > 0 or not self.link.echoes
        return self._rest_polls >= (1 if executed else UNECHOED_POLLS)

    def _at_rest(self) -> RestState:
        link = self.link
        link.events.clear()
        if link.echoes:
            link.echo.resume()  # everything that was sent has been executed
        with suppress(ExecutionStopped):  # the arm is at rest, even if the link is lost now
            link.restarted = link.restarted or (self._by_axis and group_is_gone(link))
        note = "the unit has lost its positions: home it again" if link.restarted else ""
        return RestState(True, self.counts if self.axes else None, self.status, note, self.stops)
