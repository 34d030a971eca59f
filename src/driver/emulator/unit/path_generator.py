"""The coordinated path generator: a queue of segments, run through at 1 kHz by the rate of one parameter.

Controller's fact sheet, section 2, rows 7 and 10 to 16. The path is kept exactly; only the parameter's rate is
planned. Before a segment is appended, the vertex between it and the one before gets the highest pair of rates at
which every axis' jump of speed stays within COORDDISCONT acceleration steps of 1 ms. The newest segment ends at rest;
a backward pass raises the speeds of earlier vertices. So a queue that runs empty ends at rest on its last point.
"""

from __future__ import annotations

import math
from collections import deque

from driver.emulator.unit.segment import QueuedSegment

_DONE = 1.0 - 1e-9  # u from here on is the end: 100 times 1/100 is not quite 1


class PathGenerator:
    """Queue and run-time part of the planner. `at` is the reference position in the unit's counts.

    Attributes:
        running: a segment is being executed.
        stopping: braking on the path; whatever is left is dropped at rest.
        number: of the segment being executed, or of the last one.
        u: parameter within it, 0 when idle.
        begun: how many segments have begun to be executed.
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
    def running(self) -> bool:
        return bool(self.queue)

    @property
    def end(self) -> tuple[int, ...]:
        """Where the next segment starts: the end of the newest, or the reference at rest."""
        return self.queue[-1].end if self.queue else self.at

    def append(self, segment: QueuedSegment, vertex_steps: float) -> None:
        """Add a segment that starts at `end`; `vertex_steps` is COORDDISCONT."""
        if not math.isfinite(segment.rate):  # no way and no time: done before it began
            self.number = segment.number if not self.queue else self.number
            return
        if self.queue:
            segment.vertex = _vertex(self.queue[-1], segment, vertex_steps)
        self.queue.append(segment)
        self._backward_pass()
        if len(self.queue) == 1:  # the first millisecond adds one gain
            self.u, self.number = 0.0, segment.number
            self.begun += 1
            self._rate = max(segment.vertex[1] - segment.gain, 0.0)

    def stop(self) -> None:
        """Brake at the axes' accelerations, on the path, through as many segments as it takes."""
        self.stopping = bool(self.queue)

    def abort(self) -> None:
        """Stand where it is: the brakes."""
        self.queue.clear()
        self.stopping, self.u, self._rate = False, 0.0, 0.0

    def tick(self) -> None:
        """One millisecond."""
        time = 1.0
        while self.queue and time > 0.0:
            segment = self.queue[0]
            rate = self._planned(segment) if time == 1.0 else self._rate
            if rate <= 0.0:  # only braking ends here
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
        """The rate of the coming millisecond: up by the gain, never above what still lets it brake to `leave`."""
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
        """From the newest segment back: each vertex as fast as what follows can still brake from."""
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
    """Highest rate of a millisecond from which steps of -gain reach `leave` within what is `left` of u."""
    return -gain / 2.0 + math.sqrt(gain * gain / 4.0 + leave * (leave + gain) + 2.0 * gain * left)


def _vertex(before: QueuedSegment, after: QueuedSegment, steps: float) -> tuple[float, float]:
    """Highest rates at the end of one segment and the start of the next, their ratio either that of the segments'
    own rates or the one that makes the jump smallest, whichever lets the slower of both pass faster."""
    allowed = [steps * min(a, b) for a, b in zip(before.acceleration, after.acceleration, strict=True)]
    a, b = before.end_slope, after.start_slope
    if not any(a) and not any(b):
        return before.rate, after.rate
    best, chosen = -1.0, (0.0, 0.0)
    for pair in _ratios(before, after, a, b):
        scale = min(
            1.0,
            *(
                n / jump
                for n, x, y in zip(allowed, a, b, strict=True)
                if (jump := abs(x * pair[0] - y * pair[1])) > 0.0
            ),
            1.0,
        )
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
    if along > 0.0 and length > 0.0:  # after = before * along / length makes the weighted jump smallest
        ratio = along / length
        first = min(before.rate, after.rate / ratio)
        pairs.append((first, first * ratio))
    return pairs
