"""The coordinated path generator: a queue of segments, executed at 1 kHz by planning the rate of one parameter.

Source: docs/sources.md, "Coordinated motion", rows 7 and 10 to 16. The path is kept exactly; only the
parameter's rate is planned. When a segment is appended, the vertex between it and the one before gets the highest pair
of rates at which the speed jump of every axis stays within COORDDISCONT acceleration steps of 1 ms. The last segment
ends at rest; a backward pass raises the speeds of earlier vertices. So a queue that runs empty ends at rest on its last
point.
"""

from __future__ import annotations

import math
from collections import deque

from driver.emulator.unit.segment import QueuedSegment

_DONE = 1.0 - 1e-9  # u from here on counts as the end, as 100 times 1/100 is not exactly 1


class PathGenerator:
    """Segment queue and execution. `at` is the reference position in the unit's counts.

    Attributes:
        stopping: braking on the path; the remaining segments are dropped at rest.
        number: of the present segment, or of the last one.
        u: parameter of the present segment, 0 when idle.
        begun: number of segments begun.
    """

    def __init__(self, at: tuple[int, ...]) -> None:
        self.at = at
        self.queue: deque[QueuedSegment] = deque()
        self.stopping = False
        self.number = 0
        self.u = 0.0
        self.begun = 0
        self._rate = 0.0

    @property
    def end(self) -> tuple[int, ...]:
        """Start of the next segment: the end of the last one queued, or the reference at rest."""
        return self.queue[-1].end if self.queue else self.at

    def append(self, segment: QueuedSegment, vertex_steps: float) -> None:
        """Append a segment that starts at `end`; `vertex_steps` is COORDDISCONT."""
        if not math.isfinite(segment.rate):  # zero length and zero time: done at once
            self.number = segment.number if not self.queue else self.number
            return
        if self.queue:
            segment.vertex = _vertex(self.queue[-1], segment, vertex_steps)
        self.queue.append(segment)
        self._backward_pass()
        if len(self.queue) == 1:  # the first tick adds one gain
            self.u, self.number = 0.0, segment.number
            self.begun += 1
            self._rate = max(segment.vertex[1] - segment.gain, 0.0)

    def stop(self) -> None:
        """Brake on the path at the axes' accelerations, through as many segments as needed."""
        self.stopping = bool(self.queue)

    def abort(self) -> None:
        """Stop at once, as by the brakes."""
        self.queue.clear()
        self.stopping, self.u, self._rate = False, 0.0, 0.0

    def tick(self) -> None:
        """Advance by one millisecond."""
        time = 1.0
        while self.queue and time > 0.0:
            segment = self.queue[0]
            rate = self._planned(segment) if time == 1.0 else self._rate
            if rate <= 0.0:  # only when braking
                self.abort()
                return
            left = 1.0 - self.u
            if self.u + rate * time < _DONE:
                self.u += rate * time
                self._rate = rate
                self.at = segment.at(self.u)
                return
            time -= left / rate
            self._leave(segment, rate)

    def _planned(self, segment: QueuedSegment) -> float:
        """Rate of the next millisecond: up by the gain, at most the rate from which it can brake to `leave`."""
        gain = segment.gain
        if self.stopping:
            return self._rate - gain
        rate = min(self._rate + gain, segment.rate)
        if math.isfinite(gain):
            rate = min(rate, braking_rate(gain, 1.0 - self.u, segment.leave))
        return rate

    def _leave(self, segment: QueuedSegment, rate: float) -> None:
        self.queue.popleft()
        self.at = segment.end
        if not self.queue:
            self.abort()
            return
        before, after = self.queue[0].vertex
        if self.stopping and before <= 0.0:
            self.abort()
            return
        self._enter(self.queue[0], after * min(rate / before, 1.0) if before > 0.0 else 0.0)

    def _enter(self, segment: QueuedSegment, rate: float) -> None:
        self.u, self.number = 0.0, segment.number
        self.begun += 1
        self._rate = min(rate, segment.rate)
        if math.isfinite(segment.gain):
            self._rate = min(self._rate, braking_rate(segment.gain, 1.0, segment.leave))
        if self._rate <= 0.0:  # a ramp from rest
            self._rate = min(segment.rate, segment.gain)

    def _backward_pass(self) -> None:
        """From the last segment back, raise each vertex to the speed from which what follows can still brake."""
        later = self.queue[-1]
        for index in range(len(self.queue) - 2, -1, -1):
            segment = self.queue[index]
            before, after = later.vertex
            entry = math.sqrt(later.leave**2 + 2.0 * later.gain) if math.isfinite(later.gain) else math.inf
            leave = before * min(1.0, entry / after) if after > 0.0 else before
            if leave <= segment.leave and index < len(self.queue) - 2:
                return
            segment.leave = leave
            later = segment


def braking_rate(gain: float, left: float, leave: float) -> float:
    """Return the highest rate from which steps of -gain per ms reach `leave` within the remaining u, `left`."""
    return -gain / 2.0 + math.sqrt(gain * gain / 4.0 + leave * (leave + gain) + 2.0 * gain * left)


def _vertex(before: QueuedSegment, after: QueuedSegment, steps: float) -> tuple[float, float]:
    """Highest rates at the end of one segment and the start of the next. Their ratio is that of the segments' own rates
    or the one with the smallest jump, whichever allows the higher speed in the slower segment."""
    allowed = [steps * min(a, b) for a, b in zip(before.acceleration, after.acceleration, strict=True)]
    a, b = before.end_slope, after.start_slope
    if not any(a) and not any(b):
        return before.rate, after.rate
    best, chosen = -1.0, (0.0, 0.0)
    for pair in _ratios(before, after, a, b):
        jumps = [abs(x * pair[0] - y * pair[1]) for x, y in zip(a, b, strict=True)]
        scale = min([1.0, *(n / jump for n, jump in zip(allowed, jumps, strict=True) if jump > 0.0)])
        worth = scale * min(pair[0] / before.rate, pair[1] / after.rate)
        if worth > best:
            best, chosen = worth, (scale * pair[0], scale * pair[1])
    return chosen


def _ratios(
    before: QueuedSegment, after: QueuedSegment, a: tuple[float, ...], b: tuple[float, ...]
) -> list[tuple[float, float]]:
    pairs = [(before.rate, after.rate)]
    weight = [1.0 / (n * n) for n in before.acceleration]
    along = sum(w * x * y for w, x, y in zip(weight, a, b, strict=True))
    length = sum(w * y * y for w, y in zip(weight, b, strict=True))
    if along > 0.0 and length > 0.0:  # after = before * along / length minimises the weighted jump
        ratio = along / length
        first = min(before.rate, after.rate / ratio)
        pairs.append((first, first * ratio))
    return pairs
