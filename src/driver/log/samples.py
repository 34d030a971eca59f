"""Position samples of a wire log, on one clock that does not wrap."""

from __future__ import annotations

from dataclasses import dataclass, replace

from driver.line.protocol import CLOCK_RANGE_MS, MalformedAnswer, Position, parse_position

AXES = 6
SLACK_S = 1.0  # by which an answer may be later than the one before it,
SLACK_WALL_S = 1.0  # and the same of a busy host, wall time


@dataclass(frozen=True)
class LoggedSample:
    """One answer to COORDAP.

    Attributes:
        time_s: when the unit took it, on the log's clock: the unit's own milliseconds, shifted so that the quickest
            answer took no time. Free of the line's and the host's delays.
        heard_s: when its last byte was received.
        position: as answered.
    """

    time_s: float
    heard_s: float
    position: Position


class SampleReader:
    """Collects samples. The unit's clock wraps every 65.536 s; the host's tells how often.

    A sample whose clock does not fit the host's is damaged if the next one fits again; else the unit was switched off
    and on in between, and its clock is taken anew.

    Attributes:
        damaged: samples left out.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._axes = AXES
        self._slack_s = SLACK_S
        self._done: list[LoggedSample] = []
        self._epoch: list[LoggedSample] = []  # time_s is the unit's clock, unwrapped, until it is over
        self._doubted: LoggedSample | None = None

    def open(self, time_scale: float) -> None:
        """The log's clock runs that much faster than the wall's."""
        self._slack_s = SLACK_S + SLACK_WALL_S * time_scale

    def sent(self, line: str) -> None:
        """A line that was sent: it may change how many axes are told."""
        if line.startswith("COORDGRP:") and (letters := line[9:]):
            self._axes = len(letters.split(","))

    def answer(self, heard_s: float, text: str) -> None:
        """The text of an answer to COORDAP."""
        try:
            position = parse_position(text, self._axes)
        except MalformedAnswer:
            self.damaged += 1
            return
        sample = LoggedSample(position.time_ms / 1e3, heard_s, position)
        for before in self._epoch[-1:]:
            fitting = self._fitting(before, sample)
            if fitting is None:
                self._doubt(sample)
                return
            sample = fitting
        self.damaged += self._doubted is not None
        self._doubted = None
        self._epoch.append(sample)

    def _fitting(self, before: LoggedSample, sample: LoggedSample) -> LoggedSample | None:
        """The sample with its clock unwrapped, if that fits the one before it."""
        wrap_s = CLOCK_RANGE_MS / 1e3
        passed_s = sample.heard_s - before.heard_s
        unit_s = sample.position.time_ms / 1e3
        time_s = unit_s + wrap_s * round((before.time_s + passed_s - unit_s) / wrap_s)
        late_s = time_s - before.time_s - passed_s
        if time_s < before.time_s or abs(late_s) > self._slack_s:
            return None
        return replace(sample, time_s=time_s)

    def _doubt(self, sample: LoggedSample) -> None:
        """A sample that does not fit: with another like it before, the unit's clock has been set anew."""
        fitting = None if self._doubted is None else self._fitting(self._doubted, sample)
        if self._doubted is None or fitting is None:
            self.damaged += self._doubted is not None
            self._doubted = sample
            return
        self._end_epoch()
        self._epoch = [self._doubted, fitting]
        self._doubted = None

    def _end_epoch(self) -> None:
        shift_s = min((s.heard_s - s.time_s for s in self._epoch), default=0.0)
        self._done += [replace(s, time_s=s.time_s + shift_s) for s in self._epoch]
        self._epoch = []

    def finish(self) -> tuple[LoggedSample, ...]:
        """All samples that were sound."""
        self.damaged += self._doubted is not None
        self._doubted = None
        self._end_epoch()
        return tuple(self._done)
