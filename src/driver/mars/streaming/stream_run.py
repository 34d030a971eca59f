"""One run of a stream: choose the next action, interpret the unit's answers, and enforce the deadlines."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from arm.controller.segments import CountPath
from arm.controller.unit import Counts
from arm.errors import ExecutionStopped
from driver.execution.control import Control
from driver.execution.pause import Pause
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.speed_override import stretched
from driver.line.link import ANSWER_S, NoAnswer
from driver.line.protocol import (
    VERTEX_STEPS,
    Answer,
    Failed,
    MalformedAnswer,
    Position,
    Ready,
    Reply,
    Status,
    encode,
    encode_query,
    encode_segment,
    parse_integer,
    parse_position,
    parse_status,
)
from driver.line.unit_time import SLACK_S
from driver.mars.ready import refuse_failure
from driver.mars.running import Running
from driver.mars.session import Session
from driver.mars.streaming.feed import Feed
from driver.mars.streaming.path_watch import PathWatch
from driver.mars.streaming.polls import Poll, Polls

STALL_S = 5.0  # a segment may take this much longer than planned
SILENT_POLLS, SILENT_TRIPS = 3.0, 4.0  # poll periods, and round trips, without an answer: it is silent
REPEAT_S = 0.5  # an unanswered poll is repeated after this time,
REPEAT_TRIPS = 2.5  # but not before this many round trips
REPEAT_WALL_S = 0.1  # and this much wall time
IDLE_S = 1.0  # R is sent again to a unit that is idle for this time without answering R!,
IDLE_POLLS = 2  # but not before this many polls
UNLOCATED = 3  # with more answers to ST in a row and none to COORDAP, the group is gone
STEP_S = 0.25  # longest wait
LEAST_STEP_S = 0.001  # shortest wait


def encoded(path: CountPath, knots: Counts) -> list[str]:
    """Return the line of each segment; `knots` (m + 1, 6) are where the segments begin and end."""
    return [encode_segment(s, end) for s, end in zip(path.segments, knots[1:].tolist(), strict=True)]


@dataclass(eq=False)
class StreamRun:
    """One run of a stream. Counts of segments leave out dwells; `done` leaves out the segment being executed."""

    mars: Session
    planned: CountPath
    on_progress: Callable[[Progress], None] | None
    options: StreamOptions
    control: Control
    slower: float = 1.0

    def __post_init__(self) -> None:
        mars, planned, options = self.mars, self.planned, self.options
        self.link = mars.link
        self.override = self.control.override
        self.path = stretched(planned, self.override)
        self.knots = planned.knots()
        self.lines = encoded(self.path, self.knots)
        self.hold: Pause | None = None  # while paused
        self.durations = [s.duration_ms / 1e3 for s in self.path.segments]
        self.feed = Feed(mars, options, self.slower)
        self.feed.plan(self.lines, self.durations)
        tube = None if self.link.echoes else options.tube_counts + mars.unit.rest_tolerance
        self.watch = PathWatch(planned, mars.unit.axes, options.following_counts, tube)
        self.begun = 0  # number of segments begun; 0 during the first dwell
        self.started: float | None = None
        self.most_ahead = 0.0
        self.samples = 0
        self.jaws: float | None = None
        self.running = Running()
        self.polls = Polls()
        self.unlocated = 0  # number of answers to ST since the last one to COORDAP
        self.heard_at = self.begun_at = self.link.clock.now()
        self.waiting = False  # R is sent
        self.ready_at: float | None = None
        self.idle = False
        self.idle_polls = 0  # idle polls in a row without R!
        self.idle_since = 0.0  # time of the first of them

    @property
    def total(self) -> int:
        return len(self.lines)

    @property
    def sent(self) -> int:
        return self.feed.sent

    @property
    def done(self) -> int:
        return self.begun if self._dwelling else max(self.begun - 1, 0)

    @property
    def _dwelling(self) -> bool:
        return self.begun <= self.feed.stood

    @property
    def stands(self) -> bool:
        """Whether no segment sent can have begun."""
        feed = self.feed
        return feed.dwells == 1 and feed.stood == 0 and self.link.clock.now() < feed.stands_until

    @property
    def at_once(self) -> tuple[int, int]:
        """Number of segments loaded before any begins, and the total number."""
        return min(self.feed.most_loaded, self.total), self.total

    def run(self) -> Sent:
        link = self.link
        self.mars.registers.tell(encode("COORDDISCONT", VERTEX_STEPS))
        link.events.clear()
        self.heard_at = self.begun_at = link.clock.now()
        try:
            while self.ready_at is None or not self.idle:
                self._step()
        except ExecutionStopped as error:
            error.data.update(segments_done=self.done, segments_sent=self.sent, ahead_s=self._ahead())
            raise
        end = self.mars.arrived(self.path.end, self.options.held_back_counts)
        self.mars.note("streamed", segments=self.sent, end=list(end))
        started = self.ready_at if self.started is None else self.started
        return Sent(
            path=CountPath(self.path.start, self.path.segments[: self.sent]),
            start_s=started,
            duration_s=self.ready_at - started,
            end_counts=end,
            ahead_s=self.most_ahead,
            samples=self.samples,
        )

    def _step(self) -> None:
        """Process what has arrived, then do what is due next: dwell, poll, send, or wait briefly."""
        link, feed, now = self.link, self.feed, self.link.clock.now()
        while (reply := link.receive(now)) is not None:
            self._take(reply)
        feed.require_verified()
        feed.require_loaded()
        self._pause_or_resume()
        next_poll = self.polls.next_at(feed.poll_s, self._repeat_s(), self.watch.doubtful)
        if self._needs_dwell():
            self._dwell()
        elif now >= next_poll and feed.dwells:
            self._poll(now)
        elif self._may_send():
            feed.send()
            self.most_ahead = max(self.most_ahead, self._ahead())
        elif self.sent == self.total and not self.waiting:
            self.waiting = True
            link.send(encode("R"))
        else:
            until = min(next_poll, feed.decide_at(), now + STEP_S)
            reply = link.receive(max(until, now + LEAST_STEP_S))
            if reply is not None:
                self._take(reply)
        self._watch()

    def _repeat_s(self) -> float:
        repeat_s = max(REPEAT_S, REPEAT_TRIPS * self.link.trip_s)
        return self.link.clock.at_least(repeat_s, REPEAT_WALL_S)

    def _needs_dwell(self) -> bool:
        """Whether a dwell is due: at the beginning, and after the unit has executed all segments that it had."""
        return self.hold is None and self.sent < self.total and (not self.feed.dwells or self._dry)

    def _dwell(self) -> None:
        self.mars.reference = None  # known again when the stream has ended
        self.feed.dwell()
        self.mars.parameters.begin()
        self.started = self.feed.stands_until if self.started is None else self.started
        self.running.forget()
        self.begun = self.sent
        self.begun_at = self.heard_at = self.link.clock.now()
        self.polls.begin()
        self._poll(self.begun_at)

    def _ahead(self) -> float:
        """Least motion that the unit still holds, the dwell included, s."""
        if not self.feed.dwells:
            return 0.0
        return max(self.feed.timeline.begins(self.sent) - self.link.clock.now(), 0.0)

    def _may_send(self) -> bool:
        if self.sent == self.total or self.hold is not None or self._dry or not self.feed.dwells:
            return False
        if not self.running.known and (
            not self.link.echoes or self.link.clock.now() > self.feed.stands_until
        ):
            return False  # the unit's segment number is not known: let it run dry, then dwell again
        held = self.sent - self.done + self._dwelling  # the running one or the dwell included
        if held >= self.options.queue:
            return False
        near = held <= 1 or self._ahead() + self.durations[self.sent] <= self.feed.ahead_s
        return (near or self.sent < self.feed.load_end) and self.feed.in_time()

    @property
    def _dry(self) -> bool:
        """Whether the unit has executed all that was sent although there are more segments."""
        return self.sent < self.total and self.begun > self.sent

    def _pause_or_resume(self) -> None:
        """Begin a pause that was asked for, or end one that is over. While it lasts, no segment is sent."""
        if self.hold is None and self.control.paused:
            self.hold = Pause(self.mars, self.control, self.path.start)
            self.hold.begin(self._ahead())
            self.feed.end_loading()
        elif self.hold is not None and self.hold.over(self._dry):
            self.hold.end(self.sent)
            self.hold = None
            self.begun_at = self.link.clock.now()
            if self._dry:
                self._restretch()

    def _restretch(self) -> None:
        """Apply the present override to the remaining segments. The arm is at rest, so its speed does not jump."""
        if self.control.override == self.override:
            return
        self.override = self.control.override
        left = CountPath(self.planned.start, self.planned.segments[self.sent :])
        left = stretched(left, self.override)
        self.path = CountPath(self.path.start, (*self.path.segments[: self.sent], *left.segments))
        self.lines[self.sent :] = encoded(left, self.knots[self.sent :])
        self.durations[self.sent :] = [s.duration_ms / 1e3 for s in left.segments]
        self.feed.plan(self.lines, self.durations)
        self.mars.note("override", factor=self.override, segments_sent=self.sent)

    def _poll(self, now: float) -> None:
        self.polls.ask(Poll(self.sent, self.feed.dwells, now))
        self.link.send(encode_query("COORDAP"))
        self.link.send(encode_query("ST"))
        if self.options.watch_jaws:
            self.link.send(encode_query("AP", self.mars.unit.gripper.axis))
        self.polls.asked_at = self.link.clock.now()

    def _take(self, reply: Reply) -> None:
        try:
            match reply:
                case Answer("COORDAP", text):
                    self._locate(parse_position(text, len(self.path.start)))
                case Answer("ST", text):
                    self._take_status(parse_status(text))
                case Answer("STAMP", text):
                    self.feed.stamped(text)
                case Answer(name, text) if name == f"AP{self.mars.unit.gripper.axis}":
                    self.jaws = self.mars.unit.gripper.fraction_closed(parse_integer(text))
                case Ready(""):
                    if self.waiting and self.ready_at is None:
                        self.ready_at, self.idle = self.link.clock.now(), False
                        self.polls.asked_at = -math.inf  # poll at once whether it is idle
        except MalformedAnswer as error:  # the next poll counts; too long without one is an error
            self.mars.note("damaged", text=str(error))

    def _take_status(self, status: Status) -> None:
        self.unlocated += 1
        if self.unlocated > UNLOCATED:  # it answers, but has no group
            self.link.restarted = True
        poll, believed = self.polls.take(status)
        refuse_failure(self.link, believed, f"segment {self.begun} of {self.total}")
        self.heard_at = self.link.clock.now()
        self.idle = not status.busy and poll.sent == self.total and poll.dwells == self.feed.dwells
        self._ask_again()
        if self.polls.idle and poll.dwells == self.feed.dwells and poll.sent + 1 > self.begun:
            self._begin(poll.sent + 1)  # all that was sent before the poll is done

    def _ask_again(self) -> None:
        """Send R again to an idle unit that does not answer: R or its answer was lost on the line."""
        unanswered = self.idle and self.waiting and self.ready_at is None
        now = self.link.clock.now()
        self.idle_polls = self.idle_polls + 1 if unanswered else 0
        if self.idle_polls <= 1:
            self.idle_since = now
        if self.idle_polls >= IDLE_POLLS and now >= self.idle_since + IDLE_S:
            self.idle_polls, self.waiting = 0, False

    def _locate(self, position: Position) -> None:
        link, now = self.link, self.link.clock.now()
        self.unlocated = 0
        if link.unit_time.jumped(self.polls.sent_at, now, position.time_ms, link.patience(SLACK_S)):
            link.restarted = True
            refuse_failure(link, Status(0), f"segment {self.begun} of {self.total}")
        poll = self.polls.oldest
        current = poll is not None and poll.dwells == self.feed.dwells
        feed, running = self.feed, self.running
        plausible = True
        if current and now < feed.stands_until:
            plausible = running.stands(position.segment, feed.stood)
            self.mars.parameters.stands(position, round(1e3 * feed.dwell_s))
        elif plausible := running.take(position.segment, self.sent, feed.timeline, now):
            if poll is not None and current and running.counted < self.sent:
                feed.timeline.not_before(running.counted, poll.asked_s)
            if running.counted > self.begun:
                self._begin(running.counted)
        self.samples += 1
        if self.hold is not None and self._dry:
            self.hold.take(position.counts, tuple(int(c) for c in self.knots[self.sent]))
        self.watch.take(position.counts, self.begun, self.sent, self._share(position), plausible)
        if self.on_progress is not None:
            planned_s = sum(self.durations[: self.done])
            self.on_progress(
                Progress(self.done, self.total, planned_s, position, self.override, self.jaws, self.durations)
            )

    def _share(self, position: Position) -> float | None:
        """Fraction of the segment `begun` that is done, or None if not known."""
        if self._dwelling or self.begun > self.running.counted:
            return 1.0 if self._dwelling else 0.0
        if position.parameter == 0 and self.begun == self.sent:
            return None  # just begun, or over: a unit at rest reports 0
        return self.mars.parameters.share(position)

    def _begin(self, begun: int) -> None:
        self.begun = begun
        self.begun_at = self.link.clock.now()

    def _watch(self) -> None:
        """Enforce the deadlines: an answer every ANSWER_S, and the end of the present segment."""
        link, now = self.link, self.link.clock.now()
        failed = any(isinstance(e, Failed) for e in link.events)
        link.events.clear()
        if failed:
            why = f"segment {self.begun} of {self.total}: the unit answered FAIL!"
            raise ExecutionStopped(why, reason="fault")
        silent_s = max(ANSWER_S, SILENT_POLLS * self.feed.poll_s + SILENT_TRIPS * link.trip_s)
        if now > self.heard_at + link.patience(silent_s):
            raise NoAnswer(f"no valid answer from the unit for {silent_s:g} s", reason="silent")
        if self.hold is not None and self._dry:
            return  # the pause has its own deadline
        running = self.feed.dwell_s if self._dwelling else 0.0
        if self.begun <= self.total and not self._dwelling:
            running = self.durations[self.begun - 1]
        if now > self.begun_at + link.patience(running + STALL_S):
            why = f"segment {self.begun} of {self.total} has not ended {STALL_S:g} s after its planned end"
            raise NoAnswer(why, reason="deadline")
