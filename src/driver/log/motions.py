"""Motions of a wire log: the segments sent for each, and the position samples taken during it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from arm.controller.segments import CountPath, Segment
from driver.line.protocol import SEQUENCE_RANGE
from driver.log.samples import AXES, LoggedSample

# Commands that end a stream, unless they address a gripper axis.
_ENDS = re.compile(r"(R|STOP|RELEASE|PURGE|HH|COORDMV|G|SPDT|COORDGRP)([A-H]?):")
# Those of them after which the end of the controller's path generator is not known.
_LOSES = ("STOP", "RELEASE", "PURGE", "HH", "G", "SPDT")
_GRIPPERS = ("G", "H")


@dataclass(frozen=True)
class LoggedMotion:
    """What was sent between two rests, and the positions sampled meanwhile.

    Attributes:
        sent_s: when the first line was sent, s on the log's clock.
        target: of an absolute motion (COORDMV), (6,) counts; None for a stream of segments.
        start: (6,) counts, or None if the log does not contain it.
        start_exact: `start` follows from what was sent; if False it was sampled, with the arm's following error.
        dwell_ms: length of the dwell before the first segment.
        dwell_s: when that dwell was sent.
        segments: the segments sent, in order.
        stands: number of segments sent before each later dwell, where the unit had run out of segments.
        ready_s: when the unit answered R!; None if it never did.
        stopped_s: when STOP was sent during the motion; None if it was not.
        number: the unit's number of the segment before the first; None if it was not read.
        samples: taken during the motion.
    """

    sent_s: float
    target: tuple[int, ...] | None = None
    start: tuple[int, ...] | None = None
    start_exact: bool = False
    dwell_ms: int = 0
    dwell_s: float = 0.0
    segments: tuple[Segment, ...] = ()
    stands: tuple[int, ...] = ()
    ready_s: float | None = None
    stopped_s: float | None = None
    number: int | None = None
    samples: tuple[LoggedSample, ...] = ()

    @property
    def path(self) -> CountPath | None:
        """The segments from their start; None without segments or without a known start."""
        if self.start is None or not self.segments:
            return None
        return CountPath(self.start, self.segments)

    @property
    def begin_s(self) -> float:
        """Earliest time at which the first segment could begin."""
        return self.dwell_s + self.dwell_ms / 1e3

    def segment_of(self, sample: LoggedSample) -> int | None:
        """Return the index of the segment that ran at a sample; -1 in the dwell, None if not known."""
        if self.number is None:
            return None
        advance = (sample.position.segment - self.number) % SEQUENCE_RANGE
        if advance > len(self.segments) + len(self.stands):
            return None
        passed = sum(place + k < advance for k, place in enumerate(self.stands))
        return advance - 1 - passed


@dataclass
class _Open:
    """A motion that is being read."""

    motion: LoggedMotion
    segments: list[Segment] = field(default_factory=list)
    stands: list[int] = field(default_factory=list)
    waits: bool = False  # R was sent

    def closed(self) -> LoggedMotion:
        return replace(self.motion, segments=tuple(self.segments), stands=tuple(self.stands))


class MotionReader:
    """Collects motions from the lines sent and the answers R!.

    Attributes:
        damaged: number of unreadable segments; the rest of their motion is left out.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._done: list[LoggedMotion] = []
        self._open: _Open | None = None
        self._at: tuple[int, ...] | None = None  # end of the controller's path generator, None if not known

    def sent(self, time_s: float, line: str, cut: bool) -> None:
        """Take a sent line."""
        name, _, rest = line.partition(":")
        if name in ("COORDSPLINET", "COORDMVT"):
            if not cut:
                self._segment(time_s, name, rest)
            return
        match = _ENDS.match(line)
        if match is None or match[2] in _GRIPPERS:
            return
        if match[1] == "R" and self._open is not None:
            self._open.waits = self._open.waits or not match[2]
            return
        behind = self._open is not None and self._open.motion.target is None and not self._open.segments
        if match[1] == "COORDMV" and behind:
            self._open = None  # only the dwell before a verified absolute move
        if self._open is not None and self._open.motion.ready_s is None and match[1] == "STOP":
            self._open.motion = replace(self._open.motion, stopped_s=time_s)
        self._close()
        if match[1] in _LOSES:
            self._at = None
        if match[1] == "COORDMV":
            target = _integers(rest)
            if target is None or len(target) != AXES:
                self.damaged += 1
                return
            self._open = _Open(LoggedMotion(time_s, tuple(target), self._at, self._at is not None))
            self._at = tuple(target)

    def _segment(self, time_s: float, name: str, rest: str) -> None:
        if self._open is not None and (self._open.waits or self._open.motion.target is not None):
            self._close()
        segment = self._parsed(name, rest)
        if segment is None:
            self.damaged += 1
            self._at = None
            self._close()
            return
        if self._open is None:
            self._open = _Open(LoggedMotion(time_s, None, self._at, self._at is not None, 0, time_s))
        is_dwell = not any(any(row) for row in segment.coefficients)
        if is_dwell and not self._open.segments:
            dwell_ms = segment.duration_ms
            self._open.motion = replace(self._open.motion, dwell_ms=dwell_ms, dwell_s=time_s)
            return
        if is_dwell and len(segment.coefficients) == 3:
            self._open.stands.append(len(self._open.segments))
            return
        self._open.segments.append(segment)
        if self._at is not None:
            self._at = tuple(int(a + d) for a, d in zip(self._at, segment.end(), strict=True))

    def _parsed(self, name: str, rest: str) -> Segment | None:
        values = _integers(rest)
        if values is None or len(values) < 2 or values[0] < 0:
            return None
        if name == "COORDMVT":
            if len(values) != 1 + AXES or self._at is None:
                return None
            return Segment(values[0], (tuple(v - a for v, a in zip(values[1:], self._at, strict=True)),))
        order = values[1]
        if not 1 <= order <= 3 or len(values) != 2 + order * AXES:
            return None
        rows = tuple(tuple(values[2 + axis * order + k] for axis in range(AXES)) for k in range(order))
        return Segment(values[0], rows)

    def ready(self, time_s: float, axis: str) -> None:
        """Take R! or Rx!."""
        if self._open is not None and self._open.waits and not axis:
            self._open.motion = replace(self._open.motion, ready_s=time_s)
            self._close()

    def _close(self) -> None:
        if self._open is not None:
            self._done.append(self._open.closed())
        self._open = None

    def finish(self, samples: Sequence[LoggedSample]) -> tuple[LoggedMotion, ...]:
        """Return all motions, each with its samples; `samples` are in the order in which they were received."""
        self._close()
        motions, index = [], 0
        followings = [*(m.sent_s for m in self._done[1:]), float("inf")][: len(self._done)]
        for motion, following_s in zip(self._done, followings, strict=True):
            end_s = following_s if motion.ready_s is None else min(motion.ready_s, following_s)
            while index < len(samples) and samples[index].heard_s < motion.sent_s:
                index += 1
            first = index
            while index < len(samples) and samples[index].heard_s <= end_s:
                index += 1
            motions.append(_sampled(motion, tuple(samples[first:index])))
        return tuple(motions)


def _sampled(motion: LoggedMotion, samples: tuple[LoggedSample, ...]) -> LoggedMotion:
    """Add samples to a motion. One taken in the dwell gives the unit's number, and the start if it is not known.

    It is the first after the dwell was sent, as the driver asks at once: an emulated unit that runs faster than the
    log's clock has its dwell behind it at a later one.
    """
    standing = [s for s in samples if motion.dwell_ms and motion.dwell_s <= s.heard_s <= motion.begin_s]
    start = motion.start
    if start is None and samples:
        start = (standing or samples)[0].position.counts
    return replace(
        motion,
        start=start if start is None or len(start) == AXES else None,
        number=standing[0].position.segment if standing else None,
        samples=samples,
    )


def _integers(text: str) -> list[int] | None:
    """Comma-separated integers of up to 10 digits, or None."""
    parts = text.split(",")
    if not all(re.fullmatch(r"[+-]?[0-9]{1,10}", part) for part in parts):
        return None
    return [int(part) for part in parts]
