"""The unit's own clock, as COORDAP tells it: if it does not go on, the unit was switched off and on."""

from __future__ import annotations

from driver.line.protocol import CLOCK_RANGE_MS

SLACK_S = 2.0  # by which one answer may come later than another
RATE_FROM_S = 2.0  # of the host, over which the rate of the unit's clock is learnt
LARGEST_RATE = 10.0  # of an emulated unit whose time runs faster
DRIFT = 0.05  # of a rate that was learnt


class UnitTime:
    """Compares the unit's milliseconds, which wrap every 65.5 s, with the host's clock.

    An emulated unit may live faster than the host. So its rate is learnt from samples that follow each other. Before
    it is known, a long time without a sample tells nothing: a unit that was switched off has lost its group too.
    """

    def __init__(self) -> None:
        self._last: tuple[float, int] | None = None
        self._doubt: tuple[float, int] | None = None
        self._sure = False  # two samples have agreed: the first of all may be damaged
        self._host_s = self._unit_s = 0.0  # between samples that have agreed

    def jumped(self, now_s: float, time_ms: int, slack_s: float = SLACK_S) -> bool:
        """Whether a sample and the one before it both say that the unit's clock was set anew.

        One alone may have a digit changed by the line.
        """
        sample = (now_s, time_ms)
        agrees = self._last is not None and self._agree(self._last, sample, slack_s)
        if agrees and self._last is not None:
            self._learn(self._last, sample)
        if agrees or not self._sure:
            self._last, self._doubt, self._sure = sample, None, agrees
            return False
        anew = self._doubt is not None and self._agree(self._doubt, sample, slack_s)
        self._doubt = sample
        if anew:
            self._last, self._doubt = sample, None
        return anew

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
            slack_s += max(DRIFT, slack_s / self._host_s) * abs(host_s)  # as well as the rate is known by now
        else:
            slack_s = max(slack_s, (LARGEST_RATE - 1.0) * abs(host_s))
        off = (b[1] - a[1] - round(self._rate * host_s * 1e3)) % CLOCK_RANGE_MS
        return min(off, CLOCK_RANGE_MS - off) <= slack_s * 1e3
