"""Send segments to the unit, each early enough that the arm can be stopped before a damaged one begins."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf

from driver.execution.progress import StreamOptions
from driver.line.echo import Mismatch
from driver.line.link import LineDamaged, NoAnswer, line_damaged
from driver.line.protocol import BYTES_PER_SECOND, MAX_LINE, encode_dwell
from driver.mars.lookahead import BUSY_HOST_S, JITTER_S, JITTER_WALL_S, Needs, Timeline, braking_s, dwell_for
from driver.mars.session import Session

AHEAD_S = 0.3  # reserve of motion that the unit holds, beyond the time needed to stop and the age of a poll
BLIND_POLL_S = 0.1  # longest poll period if only the arm's position shows that a line was damaged
LEARNING_POLLS = 4  # polls during a dwell in which the parameter's scale is learnt
LONGEST_POLL_S = 1.2  # longest poll period; a unit that does not answer for 2 s counts as silent
ANSWER_S = 0.05  # transmission time of the answers to a poll
DWELLS = 4  # dwells in a row, each twice as long as the last, in which the host could send no segment
QUERY_BYTES = 15  # length of the queries of a poll
LOADING_S = 1.5  # reserve for loading a motion: the line may be dead for a second when STOP is sent
LATE_S = 0.2  # tolerance for the echo of a preloaded segment
QUERY_FACTOR = 1.1  # factor on the transmission time of segments: queries take a tenth of the line


class Feed:
    """Sends the lines of one motion.

    Args:
        slower: factor by which the line is assumed slower than nominal when preloading.

    Attributes:
        sent: number of segments sent.
        dwells: number of dwells sent.
        dwell_s: length of the last dwell, s.
        stood: segments sent before the last dwell.
        stands_until: earliest end of the last dwell, controller clock.
        timeline: earliest time at which each segment can begin.
        load_end: segments before this one are loaded and verified before any of them begins.
    """

    def __init__(self, mars: Session, options: StreamOptions, slower: float = 1.0) -> None:
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
        self._dwell = 0  # line number of the last dwell
        self._numbers: list[int] = []  # line numbers of the segments, for the echo
        self._left_s: list[float] = []  # when the last bytes of the segments leave
        self._verified = 0  # number of verified segments
        self._late_since: float | None = None
        self._stamps: deque[str] = deque()  # pending stamps behind segments, if nothing is echoed

    def plan(self, lines: Sequence[str], durations: Sequence[float]) -> None:
        """Set the segments. Those already sent must be the same as before."""
        self._lines = list(lines)
        self.timeline.change(durations)
        self._durations = list(durations)

    @property
    def needs(self) -> Needs:
        """Present times needed to notice a damaged segment and to stop."""
        link = self._link
        braking = braking_s(self._mars.speed_registers, self._mars.acceleration_registers)
        return Needs(link.trip_s, link.stop_delivery_s, braking)

    @property
    def _turn_s(self) -> float:
        """How long a poll blocks the line for segments."""
        return 3.0 * (self._link.trip_s + ANSWER_S) if self._link.takes_turns else 0.0

    @property
    def poll_s(self) -> float:
        """Poll period: longer if a poll needs an empty line, shorter if only the arm's position shows damage."""
        if not self._link.echoes and not self._mars.manners.adapter:  # an adapter's echo breaks up answers
            return min(self._options.poll_s, BLIND_POLL_S)
        return max(self._options.poll_s, min(2.0 * self._turn_s, LONGEST_POLL_S))

    @property
    def ahead_s(self) -> float:
        """Most motion that the unit should hold, s."""
        needs = self.needs
        age_s = max(self.poll_s, needs.trip_s + ANSWER_S) + needs.trip_s + ANSWER_S
        return max(self._options.ahead_s, needs.whole_s + age_s + self._turn_s + AHEAD_S)

    def dwell(self) -> None:
        """Send a dwell that is long enough to verify what follows.

        Raises:
            NoAnswer: no segment could be sent in `DWELLS` dwells.
        """
        self._idle_dwells = self._idle_dwells + 1 if self.dwells and self.stood == self.sent else 0
        if self._idle_dwells >= DWELLS:
            raise NoAnswer(f"no segment could be sent in time in {DWELLS} dwells", reason="dwell")
        link = self._link
        sizes = [round(QUERY_FACTOR * (len(line) + 1)) for line in self._lines[self.sent :]]
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
            need_s = self._learning_s
        length_s = max(self._options.dwell_ms / 1e3, need_s + jitter_s) * 2**self._idle_dwells
        length_ms = int(length_s * 1e3) + 1
        self._dwell = link.send(encode_dwell(length_ms, len(self._mars.unit.axes)))
        self.dwells += 1
        self.dwell_s = length_ms / 1e3
        self.stood = self.sent
        self.stands_until = link.line_free_at + self.dwell_s
        self.timeline.stands(self.sent, self.stands_until)

    @property
    def _learning_s(self) -> float:
        """Length of a dwell of a unit that does not echo: time to read its segment number and parameter scale."""
        one_s = max(self._link.trip_s + ANSWER_S, BLIND_POLL_S) + ANSWER_S
        return one_s * (LEARNING_POLLS if self._mars.parameters.to_learn else 1)

    def in_time(self) -> bool:
        """Whether the next segment can be sent now, and verified before it can begin."""
        link = self._link
        if not link.echoes:
            return True
        needs, now = self.needs, link.clock.now()
        if link.echo.verified < self._dwell or link.echo.unechoed_bytes >= needs.window_bytes:
            return False  # without the dwell, what follows would begin at once
        if self.sent < self.load_end:
            return True  # `require_loaded` and `require_verified` check all of these together
        size = len(self._lines[self.sent]) + 1
        decided = max(now, link.line_free_at) + size / BYTES_PER_SECOND
        decided += needs.echo_s(size, link.echo.unechoed_bytes)
        return self._due(self.sent) >= decided

    def send(self) -> None:
        """Send the next segment."""
        self._numbers.append(self._link.send(self._lines[self.sent]))
        self._left_s.append(self._link.line_free_at)
        if not self._link.echoes and not self._mars.manners.adapter:
            self._stamps.append(self._link.stamp().partition(":")[2])
        self.sent += 1

    def stamped(self, text: str) -> None:
        """Check the answer to a stamp. Without an echo a stamp follows each segment; all must be answered in order.

        Raises:
            LineDamaged: an answer is missing.
        """
        if text not in self._stamps:
            return
        if self._stamps.popleft() != text:
            raise LineDamaged("transmission error: a stamp after a segment was not answered", reason="line")

    def decide_at(self) -> float:
        """Return the latest time at which STOP still prevents the oldest unverified segment."""
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
        return min(due, late + LATE_S)  # an early STOP leaves time to send the motion again

    def _due(self, segment: int) -> float:
        """Latest time at which STOP still prevents a segment and all that are preloaded with it."""
        first = self.stood if segment < self.load_end else segment
        return self.timeline.begins(first) - self.needs.last_s(self.timeline.moving(first))

    @property
    def most_loaded(self) -> int:
        """Number of segments that the unit holds besides a dwell."""
        return self._options.queue - 1

    def end_loading(self) -> None:
        """Stop preloading: only segments already sent are verified before the motion begins."""
        self.load_end = min(self.load_end, self.sent)

    def require_loaded(self) -> None:
        """Refuse to let a motion begin before it is preloaded.

        Raises:
            LineDamaged: the line is slower than expected.
        """
        if self.dwells and self.sent < self.load_end and self._link.clock.now() >= self._due(self.stood):
            raise LineDamaged(
                f"only {self.sent} of {self.load_end} segments were loaded in time: the serial line is too slow",
                reason="line",
            )

    def require_verified(self) -> None:
        """Refuse to continue if a segment without an echo is about to begin.

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
        raise line_damaged(
            f"transmission error: no echo of segment {segment + 1} of {len(self._lines)}, which would begin in "
            f"{self.timeline.begins(segment) - now:.2f} s: sent {line!r}",
            Mismatch(line, ""),
        )
