"""The unit's own clock, read by COORDAP: if it jumps, the unit was switched off and on."""

from __future__ import annotations

from driver.line.protocol import CLOCK_RANGE_MS

SLACK_S = 2.0  # tolerance for answers that come late
RATE_FROM_S = 2.0  # host time needed to learn the rate of the unit's clock
LARGEST_RATE = 10.0  # unit seconds per host second, of the fastest emulated unit
DRIFT = 0.05  # relative tolerance of the learnt rate


class UnitTime:
    """Compares the unit's milliseconds, which wrap every 65.5 s, with the host's clock.

    The clock of an emulated unit may run faster than the host's, so its rate is learnt from consecutive samples. Until
    the rate is known, a long gap between samples proves nothing. A power cycle then shows only by the lost group.
    """

    def __init__(self) -> None:
        self._last: tuple[float, int] | None = None
        self._doubt: tuple[float, int] | None = None
        self._sure = False  # two samples have agreed; the very first may be damaged
        self._host_s = self._unit_s = 0.0  # total time between samples that agree

    def jumped(self, now_s: float, time_ms: int, slack_s: float = SLACK_S) -> bool:
        """Whether this sample and the one before it both show that the unit's clock was reset.

        A single sample may have a digit damaged on the line.
        """
        sample = (now_s, time_ms)
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

    def _learn(self, a: tuple[float, int], b: tuple[float, int]) -> None:
        host_s, unit_ms = b[0] - a[0], (b[1] - a[1]) % CLOCK_RANGE_MS
        wraps = round((self._rate * host_s * 1e3 - unit_ms) / CLOCK_RANGE_MS)
        self._host_s += host_s
        self._unit_s += (unit_ms + wraps * CLOCK_RANGE_MS) / 1e3

    @property
    def _rate(self) -> float:
        return self._unit_s / self._host_s if self._host_s >= RATE_FROM_S else 1.0

    def _agree(self, a: tuple[float, int], b: tuple[float, int], slack_s: float) -> bool:
        host_s = b[0] - a[0]
        if self._host_s >= RATE_FROM_S:
            slack_s += max(DRIFT, slack_s / self._host_s) * abs(host_s)  # uncertainty of the rate
        else:
            slack_s = max(slack_s, (LARGEST_RATE - 1.0) * abs(host_s))
        off = (b[1] - a[1] - round(self._rate * host_s * 1e3)) % CLOCK_RANGE_MS
        return min(off, CLOCK_RANGE_MS - off) <= slack_s * 1e3
