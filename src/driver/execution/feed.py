"""Feeding segments to the unit, each early enough that a damaged one can still be stopped."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf

from driver.execution.progress import StreamOptions
from driver.line.link import LineDamaged, NoAnswer
from driver.line.protocol import BYTES_PER_SECOND, MAX_LINE, encode_dwell
from driver.mars.lookahead import BUSY_HOST_S, JITTER_S, JITTER_WALL_S, Needs, Timeline, braking_s, dwell_for
from driver.mars.mars import Mars

AHEAD_S = 0.3  # beyond what is needed, and the age of a look
BLIND_POLL_S = 0.1  # where damage shows by the arm's place alone
LEARNING_LOOKS = 4
LONGEST_POLL_S = 1.2  # a unit that is not heard for 2 s counts as silent
ANSWER_S = 0.05  # that the answers of a look take on the line
DWELLS = 4  # in a row in which nothing could be sent, each twice as long: the host is asleep
QUERY_BYTES = 15  # of a look
LOADING_S = 1.5  # beyond what the line needs to load a motion: it may be dead for a second when STOP is sent
LATE_S = 0.2  # beyond what an echo takes, for one of what is loaded
LOOKS = 1.1  # queries take a tenth of the line


class Feed:
    """Sends the lines of one motion.

    Attributes:
        sent: segments.
        dwells: how often the unit was told to stand before what follows.
        dwell_s: how long the last time, s.
        stood: segments sent before that.
        stands_until: when that is over at the earliest, controller clock.
        timeline: when segments can begin.
        load_end: segments before this one are loaded, and come back, before any of them begins.

    Args:
        slower: than it should be, the line is so many times; for what is loaded before it begins.
    """

    def __init__(self, mars: Mars, options: StreamOptions, slower: float = 1.0) -> None:
        self._mars, self._link, self._options = mars, mars.link, options
        self._slower = slower
        self.load_end = 0
        self.sent = 0
        self.timeline = Timeline(())
        self.dwells = 0
        self.dwell_s = 0.0
        self.stood = 0
        self.stands_until = 0.0
        self._idle_dwells = 0
        self._dwell = 0  # number of its line
        self._numbers: list[int] = []  # of the lines sent, for the echo,
        self._left_s: list[float] = []  # and when their last bytes leave
        self._verified = 0  # segments
        self._late_since: float | None = None
        self._stamps: deque[str] = deque()  # behind segments, where nothing is echoed

    def plan(self, lines: Sequence[str], durations: Sequence[float]) -> None:
        """Segments are these; those that were sent are the same as before."""
        self._lines = list(lines)
        self.timeline.change(durations)
        self._durations = list(durations)

    @property
    def needs(self) -> Needs:
        """What noticing and stopping takes now."""
        link = self._link
        braking = braking_s(self._mars.speed_registers, self._mars.acceleration_registers)
        return Needs(link.trip_s, link.stop_delivery_s, braking)

    @property
    def _turn_s(self) -> float:
        """How long a look keeps the line from segments."""
        return 3.0 * (self._link.trip_s + ANSWER_S) if self._link.takes_turns else 0.0

    @property
    def poll_s(self) -> float:
        """Between two looks; longer where the line has to be empty for them, shorter where they are all there is."""
        if not self._link.echoes and not self._mars.manners.adapter:  # whose echo tears answers apart
            return min(self._options.poll_s, BLIND_POLL_S)
        return max(self._options.poll_s, min(2.0 * self._turn_s, LONGEST_POLL_S))

    @property
    def ahead_s(self) -> float:
        """Most motion that the unit should hold, s."""
        needs = self.needs
        age_s = max(self.poll_s, needs.trip_s + ANSWER_S) + needs.trip_s + ANSWER_S
        return max(self._options.ahead_s, needs.whole_s + age_s + self._turn_s + AHEAD_S)

    def dwell(self) -> None:
        """Let the unit stand until what follows can be verified.

        Raises:
            NoAnswer: nothing could be sent in `DWELLS` of them.
        """
        self._idle_dwells = self._idle_dwells + 1 if self.dwells and self.stood == self.sent else 0
        if self._idle_dwells >= DWELLS:
            raise NoAnswer(f"nothing could be sent in time in {DWELLS} dwells", reason="dwell")
        link = self._link
        sizes = [round(LOOKS * (len(line) + 1)) for line in self._lines[self.sent :]]
        begins = len(encode_dwell(1000, len(self._mars.unit.axes))) + QUERY_BYTES
        begins += round(self._turn_s * BYTES_PER_SECOND)
        if self._options.preload:
            sizes = sizes[: self.most_loaded]
            self.load_end = self.sent + len(sizes)
        durations = self._durations[self.sent : self.sent + len(sizes)]
        need_s = dwell_for(self.needs, sizes, durations, begins, self._options.preload)
        jitter_s = link.clock.at_least(JITTER_S, JITTER_WALL_S)
        if self._options.preload:
            need_s = need_s * self._slower + LOADING_S
        if not link.echoes:
            need_s = self._looks_s
        length_s = max(self._options.dwell_ms / 1e3, need_s + jitter_s) * 2**self._idle_dwells
        length_ms = int(length_s * 1e3) + 1
        self._dwell = link.send(encode_dwell(length_ms, len(self._mars.unit.axes)))
        self.dwells += 1
        self.dwell_s = length_ms / 1e3
        self.stood = self.sent
        self.stands_until = link.line_free_at + self.dwell_s
        self.timeline.stands(self.sent, self.stands_until)

    @property
    def _looks_s(self) -> float:
        """What a unit that does not echo is looked at for while it stands: its numbers, and what they count to."""
        look_s = max(self._link.trip_s + ANSWER_S, BLIND_POLL_S) + ANSWER_S
        return look_s * (LEARNING_LOOKS if self._mars.parameters.to_learn else 1)

    def in_time(self) -> bool:
        """Whether the next segment can still be verified before it could begin, and the unit has room for its line."""
        link = self._link
        if not link.echoes:
            return True
        needs, now = self.needs, link.clock.now()
        if link.echo.verified < self._dwell or link.echo.unechoed_bytes >= needs.window_bytes:
            return False  # a dwell that was lost, or joined with what follows, lets that begin at once
        if self.sent < self.load_end:
            return True  # `require_loaded` and `require_verified` watch over all of it together
        size = len(self._lines[self.sent]) + 1
        decided = max(now, link.line_free_at) + size / BYTES_PER_SECOND
        decided += needs.echo_s(size, link.echo.unechoed_bytes)
        return self._due(self.sent) >= decided

    def send(self) -> None:
        """The next segment."""
        self._numbers.append(self._link.send(self._lines[self.sent]))
        self._left_s.append(self._link.line_free_at)
        if not self._link.echoes and not self._mars.manners.adapter:
            self._stamps.append(self._link.stamp().partition(":")[2])
        self.sent += 1

    def stamped(self, text: str) -> None:
        """A stamp was answered: where nothing is echoed, those behind segments are answered one by one.

        Raises:
            LineDamaged: one was not.
        """
        if text not in self._stamps:
            return
        if self._stamps.popleft() != text:
            raise LineDamaged("a stamp behind a segment was not answered: the line is damaged", reason="line")

    def decide_at(self) -> float:
        """The last moment at which STOP keeps the oldest segment that was not verified from beginning."""
        if not self._link.echoes:
            return inf
        while self._verified < self.sent and self._numbers[self._verified] <= self._link.echo.verified:
            self._verified += 1
        if self._verified == self.sent:
            self._late_since = None
            return inf
        due = self._due(self._verified)
        if self._verified >= self.load_end:
            return due
        late = self._left_s[self._verified] + self.needs.echo_s(MAX_LINE, self._link.echo.unechoed_bytes)
        return min(due, late + LATE_S)  # the sooner it is sent again, the more time is left for that STOP

    def _due(self, segment: int) -> float:
        """The last moment at which STOP keeps a segment, or all that is loaded together with it, from beginning."""
        first = self.stood if segment < self.load_end else segment
        return self.timeline.begins(first) - self.needs.last_s(self.timeline.moving(first))

    @property
    def most_loaded(self) -> int:
        """Segments that the unit holds beside a dwell."""
        return self._options.queue - 1

    def end_loading(self) -> None:
        """What was not sent by now is not loaded before what was begins."""
        self.load_end = min(self.load_end, self.sent)

    def require_loaded(self) -> None:
        """Refuse to let a motion begin that is to be loaded first and is not.

        Raises:
            LineDamaged: the line carries less than it should.
        """
        if self.dwells and self.sent < self.load_end and self._link.clock.now() >= self._due(self.stood):
            raise LineDamaged(
                f"{self.sent} of {self.load_end} segments were loaded in time: the line is slower than it should be",
                reason="line",
            )

    def require_verified(self) -> None:
        """Refuse to go on with a segment that has not come back and is about to begin.

        Raises:
            LineDamaged: with the line.
        """
        clock = self._link.clock
        now = clock.now()
        if now < self.decide_at():
            return
        self._late_since = now if self._late_since is None else self._late_since
        if now < self._late_since + clock.at_least(BUSY_HOST_S, BUSY_HOST_S) - BUSY_HOST_S:
            return
        segment, line = self._verified, self._lines[self._verified]
        raise LineDamaged(
            f"segment {segment + 1} of {len(self._lines)} has not come back and would begin in "
            f"{self.timeline.begins(segment) - now:.2f} s: sent {line!r}",
            sent=line,
            received="",
            column=1,
            reason="line",
        )
