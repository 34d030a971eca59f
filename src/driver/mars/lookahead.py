"""How early a segment must be sent so that a damaged one never begins: time for its echo and time for a stop.

The unit may take longer than commanded but never less (docs/sources.md, "Coordinated motion", row 1). So the earliest
time at which a segment can begin follows from what was sent. For each segment there is a last moment at which STOP
still prevents it. If its echo has not come by then, the driver sends STOP.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from driver.line.protocol import BYTES_PER_SECOND, MAX_LINE

MARGIN_S = 0.05  # one STOP may be lost; the next is sent this much later
JITTER_S = 0.05  # allowance for a host that sends the first segments late,
JITTER_WALL_S = 0.01  # but at least this much wall time
BUSY_HOST_S = 0.1  # wall time: allowance for a late echo of an emulated unit that runs faster than real time
LEAST_WINDOW = 160  # bytes that may be sent ahead of their echo, at least
LINE_BYTES = 100  # length of a long segment's line
ANSWERS_BYTES = 80  # length of the answers to one status poll


@dataclass(frozen=True)
class Needs:
    """Times needed to notice a damaged segment and to stop.

    Attributes:
        trip_s: from a byte sent to its echo, on an empty line.
        stop_s: from the decision to stop until the unit has received STOP.
        braking_s: of the slowest axis from full speed to rest, under the registers in force.
    """

    trip_s: float
    stop_s: float
    braking_s: float

    def echo_s(self, line_bytes: int, unechoed_bytes: int) -> float:
        """Time from a line's last byte to the end of its echo, behind earlier echoes and the answers to one poll."""
        waiting = max(unechoed_bytes - self.trip_s * BYTES_PER_SECOND, 0.0)
        return self.trip_s + (line_bytes + waiting + ANSWERS_BYTES) / BYTES_PER_SECOND

    @property
    def whole_s(self) -> float:
        """Longest time to verify a segment and stop before it, at full speed."""
        return self.echo_s(MAX_LINE, round(self.window_bytes)) + self.last_s(self.braking_s)

    def last_s(self, moving_s: float) -> float:
        """How long before a segment begins the driver must decide on STOP, if the arm has moved for `moving_s` by then.

        The arm brakes at least as hard as it accelerated: the registers are the same.
        """
        return self.stop_s + min(self.braking_s, max(moving_s, 0.0)) + MARGIN_S

    @property
    def window_bytes(self) -> float:
        """Limit on bytes that await their echo; at the limit no further line is sent."""
        return max(LEAST_WINDOW, 2.0 * self.trip_s * BYTES_PER_SECOND + 2.0 * LINE_BYTES)


def braking_s(speed: Sequence[int], acceleration: Sequence[int]) -> float:
    """Return the time, s, of the slowest axis from full speed to rest, given REGMS and REGACC."""
    return max(v / a for v, a in zip(speed, acceleration, strict=True)) / 1e3


def dwell_for(
    needs: Needs, sizes: Sequence[int], durations: Sequence[float], first_bytes: int, preload: bool
) -> float:
    """Return the shortest dwell, s, after which every segment can be verified in time, by simulating the line.

    Args:
        sizes: bytes of the segments' lines, which are sent one after the other.
        durations: of the segments, s.
        first_bytes: bytes sent before the segments, the dwell's included; their echo comes first.
        preload: verify all segments before the first begins.
    """
    back = (2 * first_bytes + ANSWERS_BYTES) / BYTES_PER_SECOND
    sent = back + needs.trip_s
    on_way: deque[tuple[float, int]] = deque()  # arrival time of an echo, its bytes
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
    """Earliest time at which each segment can begin. Segments are numbered from 0."""

    def __init__(self, durations: Sequence[float]) -> None:
        self._ends: list[float] = []
        self._base, self._base_s = 0, 0.0
        self._rest, self._rest_s = 0, 0.0
        self.change(durations)

    def change(self, durations: Sequence[float]) -> None:
        """Set the durations of the segments, s."""
        self._ends = list(accumulate(durations, initial=0.0))

    def stands(self, segment: int, until_s: float) -> None:
        """Record that the unit waits at the beginning of a segment until that time."""
        self._base, self._base_s = segment, until_s
        self._rest, self._rest_s = segment, until_s

    def not_before(self, segment: int, at_s: float) -> None:
        """Record that a segment had not begun at that time."""
        if at_s > self.begins(segment):
            self._base, self._base_s = segment, at_s

    def begins(self, segment: int) -> float:
        """Return the earliest time at which a segment can begin."""
        return self._base_s + self._ends[segment] - self._ends[self._base]

    def moving(self, segment: int) -> float:
        """Return how long the arm has moved since its last rest when a segment begins, as planned, s."""
        return self.begins(segment) - self._rest_s
