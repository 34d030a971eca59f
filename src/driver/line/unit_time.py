"""The unit's own clock, read by COORDAP: if it jumps, the unit was switched off and on."""

from __future__ import annotations

from typing import NamedTuple

from driver.line.protocol import CLOCK_RANGE_MS

SLACK_S = 2.0  # tolerance for answers that come late
RATE_FROM_S = 2.0  # host time needed to learn the rate of the unit's clock
LARGEST_RATE = 10.0  # unit seconds per host second, of the fastest emulated unit
DRIFT = 0.05  # relative tolerance of the learnt rate


class _Sample(NamedTuple):
    asked_s: float
    taken_s: float
    time_ms: int


class UnitTime:
    """Compares the unit's milliseconds, which wrap every 65.5 s, with the host's clock.

    The unit reads its clock between the host's question and the host's look at the answer. A busy host looks late, and
    only once; so both times count, not the later one alone.

    The clock of an emulated unit may run faster than the host's, so its rate is learnt from consecutive samples. Until
    the rate is known, a long gap between samples proves nothing. A power cycle then shows only by the lost group.
    """

    def __init__(self) -> None:
        self._last: _Sample | None = None
        self._doubt: _Sample | None = None
        self._sure = False  # two samples have agreed; the very first may be damaged
        self._host_s = self._unit_s = 0.0  # total time between samples that agree

    def jumped(self, asked_s: float, now_s: float, time_ms: int, slack_s: float = SLACK_S) -> bool:
        """Whether this sample and the one before it both show that the unit's clock was reset.

        A single sample may have a digit damaged on the line.

        Args:
            asked_s: host's time of the question.
            now_s: host's time at which its answer is looked at.
            time_ms: the unit's time in the answer, in ms.
            slack_s: tolerance of the comparison, in unit seconds.
        """
        sample = _Sample(asked_s, now_s, time_ms)
        agrees = self._last is not None and self._agree(self._last, sample, slack_s)
        if agrees and self._last is not None:
            self._learn(self._last, sample)
        if agrees or not self._sure:
            self._last, self._doubt, self._sure = sample, None, agrees
            return False
        reset = self._doubt is not None and self._agree(self._doubt, sample, slack_s)
        self._doubt = sample
        if reset:
            self._last, self._doubt = sample, None
        return reset

    def _learn(self, a: _Sample, b: _Sample) -> None:
        host_s, unit_ms = b.taken_s - a.taken_s, (b.time_ms - a.time_ms) % CLOCK_RANGE_MS
        wraps = round((self._rate * host_s * 1e3 - unit_ms) / CLOCK_RANGE_MS)
        self._host_s += host_s
        self._unit_s += (unit_ms + wraps * CLOCK_RANGE_MS) / 1e3

    @property
    def _rate(self) -> float:
        return self._unit_s / self._host_s if self._host_s >= RATE_FROM_S else 1.0

    def _agree(self, a: _Sample, b: _Sample, slack_s: float) -> bool:
        shortest_s, longest_s = b.asked_s - a.taken_s, b.taken_s - a.asked_s
        host_s = (shortest_s + longest_s) / 2.0
        if self._host_s >= RATE_FROM_S:
            slack_s += max(DRIFT, slack_s / self._host_s) * abs(host_s)  # uncertainty of the rate
        else:
            slack_s = max(slack_s, (LARGEST_RATE - 1.0) * abs(host_s))
        slack_s += self._rate * (longest_s - shortest_s) / 2.0
        off = (b.time_ms - a.time_ms - round(self._rate * host_s * 1e3)) % CLOCK_RANGE_MS
        return min(off, CLOCK_RANGE_MS - off) <= slack_s * 1e3
