"""The unit's own clock, as COORDAP tells it: if it does not go on, the unit was switched off and on."""

from __future__ import annotations

from driver.protocol import CLOCK_RANGE_MS

SLACK_S = 2.0  # by which one answer may come later than another


class UnitTime:
    """Compares the unit's milliseconds, which wrap every 65.5 s, with the host's clock."""

    def __init__(self) -> None:
        self._last: tuple[float, int] | None = None
        self._doubt: tuple[float, int] | None = None
        self._sure = False  # two samples have agreed: the first of all may be damaged

    def jumped(self, now_s: float, time_ms: int, slack_s: float = SLACK_S) -> bool:
        """Whether a sample and the one before it both say that the unit's clock was set anew.

        One alone may have a digit changed by the line.
        """
        sample = (now_s, time_ms)
        agrees = self._last is not None and _agree(self._last, sample, slack_s)
        if agrees or not self._sure:
            self._last, self._doubt, self._sure = sample, None, agrees
            return False
        anew = self._doubt is not None and _agree(self._doubt, sample, slack_s)
        self._doubt = sample
        if anew:
            self._last, self._doubt = sample, None
        return anew


def _agree(a: tuple[float, int], b: tuple[float, int], slack_s: float) -> bool:
    off = (b[1] - a[1] - round((b[0] - a[0]) * 1e3)) % CLOCK_RANGE_MS
    return min(off, CLOCK_RANGE_MS - off) <= slack_s * 1e3
