"""Position samples of a wire log, on one clock without wraps."""

from __future__ import annotations

from dataclasses import dataclass, replace

from driver.line.protocol import CLOCK_RANGE_MS, MalformedAnswer, Position, parse_position

AXES = 6
SLACK_S = 1.0  # an answer may come this much later or earlier than the one before lets expect,
SLACK_WALL_S = 1.0  # and by this much wall time more, as the host may be busy


@dataclass(frozen=True)
class LoggedSample:
    """One answer to COORDAP.

    Attributes:
        time_s: when the unit took the sample, s on the log's clock. These are the unit's milliseconds, shifted so that
            the fastest answer has no delay. So they are free of the delays of line and host.
        heard_s: when the last byte of the answer was received.
        position: the answer.
    """

    time_s: float
    heard_s: float
    position: Position


class SampleReader:
    """Collects samples. The unit's clock wraps every 65.536 s; the host's clock determines how often.

    A sample whose time does not fit the host's clock is damaged if the next one fits again. If the next one does not
    fit either, the unit was switched off and on in between, and its clock has started again.

    Attributes:
        damaged: number of samples left out.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._axes = AXES
        self._slack_s = SLACK_S
        self._done: list[LoggedSample] = []
        self._epoch: list[LoggedSample] = []  # one power cycle; time_s is the unit's, unwrapped
        self._doubted: LoggedSample | None = None

    def open(self, time_scale: float) -> None:
        """Set how much faster than wall time the log's clock runs."""
        self._slack_s = SLACK_S + SLACK_WALL_S * time_scale

    def sent(self, line: str) -> None:
        """Take a sent line: it may change the number of axes in an answer."""
        if line.startswith("COORDGRP:") and (letters := line[9:]):
            self._axes = len(letters.split(","))

    def answer(self, heard_s: float, text: str) -> None:
        """Take the text of an answer to COORDAP."""
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
        """Return the sample with its clock unwrapped, or None if it does not fit the one before it."""
        wrap_s = CLOCK_RANGE_MS / 1e3
        passed_s = sample.heard_s - before.heard_s
        unit_s = sample.position.time_ms / 1e3
        time_s = unit_s + wrap_s * round((before.time_s + passed_s - unit_s) / wrap_s)
        late_s = time_s - before.time_s - passed_s
        if time_s < before.time_s or abs(late_s) > self._slack_s:
            return None
        return replace(sample, time_s=time_s)

    def _doubt(self, sample: LoggedSample) -> None:
        """Take a sample that does not fit. If it fits the last such sample, the unit's clock was reset."""
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
        """Return all undamaged samples."""
        self.damaged += self._doubted is not None
        self._doubted = None
        self._end_epoch()
        return tuple(self._done)
