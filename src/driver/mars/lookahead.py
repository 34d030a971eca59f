"""How early a segment must be on the unit so that a damaged one never begins: time to its echo, time to a stop.

The unit only ever takes longer than it is told (fact sheet, section 2), so the earliest time at which a segment can
begin follows from what was sent. A segment whose echo has not come by the last moment at which STOP would still be in
time stops the arm.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from driver.line.protocol import BYTES_PER_SECOND, MAX_LINE

MARGIN_S = 0.05  # for one STOP that is lost
JITTER_S = 0.05  # that a host may be late with the first segments,
JITTER_WALL_S = 0.01  # and no less than this much wall time
BUSY_HOST_S = 0.1  # wall time that an emulated unit whose time runs faster may be late with an echo
LEAST_WINDOW = 160  # bytes that may be sent without an echo
LINE_BYTES = 100  # of a long segment
ANSWERS_BYTES = 80  # of a look


@dataclass(frozen=True)
class Needs:
    """What noticing and stopping takes.

    Attributes:
        trip_s: from a byte sent to its echo, on an empty line.
        stop_s: from the decision to a STOP that the unit has.
        braking_s: slowest axis from its full speed to rest, by the registers in force.
    """

    trip_s: float
    stop_s: float
    braking_s: float

    def echo_s(self, line_bytes: int, unechoed_bytes: int) -> float:
        """From a line's last byte to the end of its echo, behind echoes that wait there and a look's answers."""
        waiting = max(unechoed_bytes - self.trip_s * BYTES_PER_SECOND, 0.0)
        return self.trip_s + (line_bytes + waiting + ANSWERS_BYTES) / BYTES_PER_SECOND

    @property
    def whole_s(self) -> float:
        """Of a segment in full motion, at most."""
        return self.echo_s(MAX_LINE, round(self.window_bytes)) + self.last_s(self.braking_s)

    def last_s(self, moving_s: float) -> float:
        """How long before a segment begins STOP must be decided on, if the arm moves for that long before it.

        It brakes at least as hard as it has accelerated: the registers are the same.
        """
        return self.stop_s + min(self.braking_s, max(moving_s, 0.0)) + MARGIN_S

    @property
    def window_bytes(self) -> float:
        """A line begins only while fewer bytes than this are sent without an echo."""
        return max(LEAST_WINDOW, 2.0 * self.trip_s * BYTES_PER_SECOND + 2.0 * LINE_BYTES)


def braking_s(speed: Sequence[int], acceleration: Sequence[int]) -> float:
    """Time of the slowest axis from its full speed to rest, s; REGMS and REGACC."""
    return max(v / a for v, a in zip(speed, acceleration, strict=True)) / 1e3


def dwell_for(
    needs: Needs, sizes: Sequence[int], durations: Sequence[float], first_bytes: int, preload: bool
) -> float:
    """Shortest stand after which every segment can be verified in time, by playing the line through, s.

    Args:
        sizes: bytes of the segments' lines, sent one behind the other as the line carries them.
        durations: of the segments, s.
        first_bytes: that are sent before them, the dwell's among them, and come back first.
        preload: all are to be verified before the first begins.
    """
    back = (2 * first_bytes + ANSWERS_BYTES) / BYTES_PER_SECOND
    sent = back + needs.trip_s
    on_way: deque[tuple[float, int]] = deque()  # when an echo is here, bytes
    moving = longest = 0.0
    for size, duration in zip(sizes, durations, strict=True):
        while on_way and sum(n for _, n in on_way) >= needs.window_bytes:
            sent = max(sent, on_way.popleft()[0])
        sent += size / BYTES_PER_SECOND
        back = max(back, sent) + size / BYTES_PER_SECOND
        on_way.append((back + needs.trip_s, size))
        longest = max(longest, back + needs.trip_s + needs.last_s(moving) - moving)
        moving += 0.0 if preload else duration
    return longest


class Timeline:
    """The earliest time at which each segment can begin. Segments are numbered from 0."""

    def __init__(self, durations: Sequence[float]) -> None:
        self._ends: list[float] = []
        self._base, self._base_s = 0, 0.0
        self._rest, self._rest_s = 0, 0.0
        self.change(durations)

    def change(self, durations: Sequence[float]) -> None:
        """Segments last that long, s."""
        self._ends = list(accumulate(durations, initial=0.0))

    def stands(self, segment: int, until_s: float) -> None:
        """The unit stands at the beginning of a segment until that time."""
        self._base, self._base_s = segment, until_s
        self._rest, self._rest_s = segment, until_s

    def not_before(self, segment: int, at_s: float) -> None:
        """A segment was seen not to have begun at that time."""
        if at_s > self.begins(segment):
            self._base, self._base_s = segment, at_s

    def begins(self, segment: int) -> float:
        """When it can begin at the earliest."""
        return self._base_s + self._ends[segment] - self._ends[self._base]

    def moving(self, segment: int) -> float:
        """For how long the arm then has moved since it stood, at least as asked for, s."""
        return self.begins(segment) - self._rest_s
