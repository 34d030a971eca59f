"""Streaming a path of integer segments to the controller, and watching it while it moves.

What is sent is what was certified, to the count. The controller keeps the path exactly and only stretches time, so
progress is read from its own segment numbers, never from the clock (fact sheet, sections 2 and 3).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.motion import CountPath
from arm.unit import Counts
from driver.control import Control
from driver.extremes import extremes
from driver.hold import Hold
from driver.link import ANSWER_S, NoAnswer
from driver.mars import Mars
from driver.override import stretched
from driver.progress import Progress, Sent, StreamOptions
from driver.protocol import (
    SEQUENCE_RANGE,
    VERTEX_STEPS,
    Answer,
    Failed,
    MalformedAnswer,
    Position,
    Ready,
    Reply,
    encode,
    encode_dwell,
    encode_query,
    encode_segment,
    parse_integer,
    parse_position,
    parse_status,
)
from driver.ready import refuse_failure
from driver.refusals import POSITION_TOLERANCE
from driver.rest import farthest

DWELL_ATTEMPTS = 4  # each twice as long: a host that is asleep misses a short one
STALL_S = 5.0  # a segment may take this much longer than planned
REPEAT_S = 0.5  # a sample that was asked for and lost on the line is asked for again after this,
REPEAT_WALL_S = 0.1  # and not before this much wall time
IDLE_LOOKS = 5  # at an idle unit that has not said R!, before it is asked again
LAG_SEGMENTS = 3  # the arm follows its reference by regulators that lag


def stream(
    mars: Mars,
    path: CountPath,
    on_progress: Callable[[Progress], None] | None = None,
    options: StreamOptions | None = None,
    control: Control | None = None,
) -> Sent:
    """Send a path from where the arm is, and wait until it has settled at its end.

    A segment of order 1 goes as a straight one (COORDMVT), any other as COORDSPLINET.

    Args:
        on_progress: called at every look, also while the arm stands in a pause.
        control: its override now stretches the segments in time, the path stays; a pause ends the feeding, so that
            the arm comes to rest on the path at most the look-ahead later, and what is left goes when the pause ends,
            with the override of then.

    Raises:
        InputError: a segment cannot be sent (duration 0, order above 3, line too long); nothing moved.
        ImpossibleError: the path leaves the unit's limits, or starts more than 25 counts from the arm; nothing moved.
        ExecutionStopped: a fault, a silent or lost link, an interrupt, an abort, an axis that does not follow, an arm
            that was displaced in a pause, an end that is not the path's; with the state and how many segments were
            done.
    """
    if not path.segments:
        raise InputError("a path without segments moves nothing")
    control = control or Control()
    _encoded(stretched(path, control.least), path.knots())  # whatever the override becomes, it can be sent
    run = _Stream(mars, path, on_progress, options or StreamOptions(), control)
    for corner in extremes(path):
        mars.refuse_outside(corner.tolist(), "the path reaches")
    with mars.guarded("stream"):
        control.require()
    with control.attached(mars.link):
        with mars.guarded("stream"):
            here = mars.require_ready()
        if farthest(here, path.start) > POSITION_TOLERANCE:
            raise ImpossibleError(
                f"the path starts {farthest(here, path.start)} counts from the arm, at most {POSITION_TOLERANCE}",
                counts=list(here),
                start=list(path.start),
            )
        if mars.reference != path.start:
            mars.anchor(path.start)
        with mars.guarded("stream"):
            return run.run()


def _encoded(path: CountPath, knots: Counts) -> list[str]:
    """A line for each segment; `knots` (m + 1, 6) are where they begin and end."""
    return [encode_segment(s, end) for s, end in zip(path.segments, knots[1:].tolist(), strict=True)]


class _Stream:
    """One run. Counting is of segments behind the dwell; the segment being executed is not done."""

    def __init__(
        self,
        mars: Mars,
        planned: CountPath,
        on_progress: Callable[[Progress], None] | None,
        options: StreamOptions,
        control: Control,
    ) -> None:
        self.mars = mars
        self.link = mars.link
        self.planned = planned
        self.override = control.override
        self.path = stretched(planned, self.override)
        self.knots = planned.knots()
        self.lines = _encoded(self.path, self.knots)
        self.on_progress = on_progress
        self.options = options
        self.control = control
        self.hold: Hold | None = None  # while paused
        self.durations = [s.duration_ms / 1e3 for s in self.path.segments]
        self.sent = 0
        self.begun = 0  # 0 while the dwell runs, then the number of segments begun
        self.dwell_s = 0.0
        self.most_ahead = 0.0
        self.samples = 0
        self.astray = 0  # samples in a row outside the stretch of path
        self.jaws: float | None = None
        self.sequence = 0  # the unit's number of the last segment seen to run,
        self.counted = 0  # and which that is by our count
        self.polls: deque[int] = deque()  # how many segments were sent before each unanswered ST?
        self.polled_at = -1.0
        self.heard_at = self.link.clock.now()
        self.begun_at = self.link.clock.now()
        self.waiting = False  # R: is sent
        self.ready_at: float | None = None
        self.idle = False
        self.idle_looks = 0  # in a row, without R!

    @property
    def total(self) -> int:
        return len(self.lines)

    @property
    def done(self) -> int:
        return max(self.begun - 1, 0)

    def run(self) -> Sent:
        link = self.link
        link.send(encode("COORDDISCONT", VERTEX_STEPS))
        link.synchronise()
        link.events.clear()
        started: float = self._dwell()
        try:
            while self.ready_at is None or not self.idle:
                self._step()
        except ExecutionStopped as error:
            error.data.update(segments_done=self.done, segments_sent=self.sent, ahead_s=self._ahead())
            raise
        end = self.mars.arrived(self.path.end)
        self.mars.note("streamed", segments=self.sent, end=list(end))
        return Sent(
            path=CountPath(self.path.start, self.path.segments[: self.sent]),
            start_s=started,
            duration_s=self.ready_at - started,
            end_counts=end,
            ahead_s=self.most_ahead,
            samples=self.samples,
        )

    def _dwell(self) -> float:
        """Start the dwell and learn its segment number; the time when it ends."""
        link = self.link
        for attempt in range(DWELL_ATTEMPTS):
            length_ms = self.options.dwell_ms << attempt
            self.mars.reference = None  # known again when the stream has ended
            link.send(encode_dwell(length_ms, len(self.path.start)))
            ends = link.clock.now() + length_ms / 1e3
            position, status = self.mars.position(), self.mars.status()
            refuse_failure(link, status, "dwell")
            if status.busy:
                self.sequence = position.segment
                self.dwell_s = length_ms / 1e3
                self.begun_at = self.heard_at = link.clock.now()
                return ends
        raise NoAnswer(f"the unit was not seen busy in {DWELL_ATTEMPTS} dwells", reason="dwell")

    def _step(self) -> None:
        """Do the next thing that is due: take what has arrived, look, send, or wait a little."""
        link, now = self.link, self.link.clock.now()
        while (reply := link.receive(now)) is not None:
            self._take(reply)
        next_poll = self.polled_at + (self._repeat_s() if self.polls else self.options.poll_s)
        if now >= next_poll:
            self._poll(now)
        elif self._may_send():
            link.send(self.lines[self.sent])
            self.sent += 1
            self.most_ahead = max(self.most_ahead, self._ahead())
        elif self.sent == self.total and not self.waiting:
            self.waiting = True
            link.send(encode("R"))
        else:
            reply = link.receive(next_poll)
            if reply is not None:
                self._take(reply)
        self._watch()

    def _repeat_s(self) -> float:
        return self.link.clock.at_least(REPEAT_S, REPEAT_WALL_S)

    def _ahead(self) -> float:
        """Planned motion that the unit holds, s; the running segment counts whole."""
        dwell = self.dwell_s if self.begun == 0 else 0.0
        return dwell + sum(self.durations[self.done : self.sent])

    def _may_send(self) -> bool:
        if self.sent == self.total or self._holds():
            return False
        held = self.sent + 1 - self.begun  # not done, the dwell included
        if held >= self.options.queue:
            return False
        return held <= 1 or self._ahead() + self.durations[self.sent] <= self.options.ahead_s

    @property
    def _dry(self) -> bool:
        """All that was sent is done, and more is to come."""
        return self.sent < self.total and self.begun > self.sent

    def _holds(self) -> bool:
        """Whether a pause holds the next segment back."""
        if self.hold is None and self.control.paused:
            self.hold = Hold(self.mars, self.control, self.path.start)
            self.hold.begin(self._ahead())
        elif self.hold is not None and self.hold.over(self._dry):
            self.hold.end(self.sent)
            self.hold = None
            self.begun_at = self.link.clock.now()
            if self._dry:
                self._restretch()
        return self.hold is not None

    def _restretch(self) -> None:
        """What is left goes with the override of now: the arm stands, so its speed does not jump."""
        if self.control.override == self.override:
            return
        self.override = self.control.override
        left = CountPath(self.planned.start, self.planned.segments[self.sent :])
        left = stretched(left, self.override)
        self.path = CountPath(self.path.start, (*self.path.segments[: self.sent], *left.segments))
        self.lines[self.sent :] = _encoded(left, self.knots[self.sent :])
        self.durations[self.sent :] = [s.duration_ms / 1e3 for s in left.segments]
        self.mars.note("override", factor=self.override, segments_sent=self.sent)

    def _poll(self, now: float) -> None:
        self.link.send(encode_query("COORDAP"))
        self.polls.append(self.sent)
        self.link.send(encode_query("ST"))
        if self.options.watch_jaws:
            self.link.send(encode_query("AP", self.mars.unit.gripper.axis))
        self.polled_at = now

    def _take(self, reply: Reply) -> None:
        try:
            match reply:
                case Answer("COORDAP", text):
                    self._locate(parse_position(text, len(self.path.start)))
                case Answer("ST", text):
                    status = parse_status(text)
                    refuse_failure(self.link, status, f"segment {self.begun} of {self.total}")
                    sent_then = self.polls.popleft() if self.polls else 0
                    self.heard_at = self.link.clock.now()
                    self.idle = not status.busy and sent_then == self.total
                    self._ask_again()
                    if not status.busy and sent_then + 1 > self.begun:
                        self._begin(sent_then + 1)  # all that it had been sent is done
                case Answer(name, text) if name == f"AP{self.mars.unit.gripper.axis}":
                    self.jaws = self.mars.unit.gripper.fraction_closed(parse_integer(text))
                case Ready(""):
                    if self.waiting and self.ready_at is None:
                        self.ready_at, self.idle = self.link.clock.now(), False
                case _:
                    pass
        except MalformedAnswer as error:  # the next look will tell; too long without one is an error
            self.mars.note("damaged", text=str(error))

    def _ask_again(self) -> None:
        """R: or its answer was lost on the line: an idle unit that says nothing is asked once more."""
        unanswered = self.idle and self.waiting and self.ready_at is None
        self.idle_looks = self.idle_looks + 1 if unanswered else 0
        if self.idle_looks >= IDLE_LOOKS:
            self.idle_looks, self.waiting = 0, False

    def _locate(self, position: Position) -> None:
        advance = (position.segment - self.sequence) % SEQUENCE_RANGE
        if advance and self.counted + advance <= self.sent:  # an idle unit may show any number
            self.sequence, self.counted = position.segment, self.counted + advance
            if self.counted > self.begun:
                self._begin(self.counted)
        self.samples += 1
        if self.hold is not None and self._dry:
            self.hold.take(position.counts, tuple(int(c) for c in self.knots[self.sent]))
        window = self.knots[max(self.begun - 1 - LAG_SEGMENTS, 0) : self.sent + 1]
        outside = np.maximum(window.min(axis=0) - position.counts, position.counts - window.max(axis=0))
        worst = int(np.argmax(outside))
        self.astray = self.astray + 1 if outside[worst] > self.options.following_counts else 0
        if self.astray >= 2:  # one may be a digit lost on the line
            raise ExecutionStopped(
                f"axis {self.mars.unit.axes[worst]} is {int(outside[worst])} counts off its path, "
                f"at most {self.options.following_counts}",
                axis=self.mars.unit.axes[worst],
                counts=list(position.counts),
                reason="following",
            )
        if self.on_progress is not None:
            planned_s = sum(self.durations[: self.done])
            self.on_progress(
                Progress(self.done, self.total, planned_s, position, self.override, self.jaws, self.durations)
            )

    def _begin(self, begun: int) -> None:
        self.begun = begun
        self.begun_at = self.link.clock.now()

    def _watch(self) -> None:
        """Deadlines: an answer at least every ANSWER_S, a new segment when the running one should be over."""
        link, now = self.link, self.link.clock.now()
        failed = any(isinstance(e, Failed) for e in link.events)
        link.events.clear()
        if failed:
            raise ExecutionStopped(
                f"segment {self.begun} of {self.total}: the unit answered FAIL!", reason="fault"
            )
        if now > self.heard_at + link.patience(ANSWER_S):
            raise NoAnswer(f"no sound answer from the unit for {ANSWER_S:g} s", reason="silent")
        if self.hold is not None and self._dry:
            return  # it waits for us, and its own deadline is the hold's
        running = self.durations[self.begun - 1] if 0 < self.begun <= self.total else self.dwell_s
        if now > self.begun_at + link.patience(running + STALL_S):
            raise NoAnswer(
                f"segment {self.begun} of {self.total} is not over {STALL_S:g} s after its time",
                reason="deadline",
            )
