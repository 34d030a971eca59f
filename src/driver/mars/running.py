"""Determine from COORDAP which of the sent segments the unit executes, and how far it has come in it.

An answer may be damaged on the line. So a segment number that the unit cannot have reached yet is rejected.
"""

from __future__ import annotations

from itertools import pairwise

from driver.line.protocol import CLOCK_RANGE_MS, SEQUENCE_RANGE, Position
from driver.mars.lookahead import Timeline

EARLY_S = 0.05  # tolerance by which a segment may begin early
STRANGE = 2  # impossible numbers in a row that prove that the reference number was damaged
LEAST_STEP_MS = 40  # shortest time between two samples from which the parameter's scale is computed
ATTEMPTS = 3  # dwells in which to learn the scale; after these it counts as unavailable
AGREE = 0.1  # largest relative difference of two such scales


class Running:
    """Counts the segments that have begun, from the unit's segment numbers.

    Attributes:
        known: whether the unit's number of any segment is known.
        counted: how many of the sent segments have begun.
    """

    def __init__(self) -> None:
        self.counted = 0
        self._sequence: int | None = None  # the unit's number of the segment `counted`
        self._strange = 0
        self._other: int | None = None  # last number read during a dwell

    @property
    def known(self) -> bool:
        return self._sequence is not None

    def forget(self) -> None:
        """Forget the reference number: the number of the next segment is not known."""
        self._sequence, self._strange, self._other = None, 0, None

    def stands(self, number: int, stood: int) -> bool:
        """Take the number of a dwell that follows `stood` segments. Return whether it agrees with the last one.

        If two numbers differ, one is damaged; the one read twice in a row is right.
        """
        if self._sequence is None or number == self._other:
            self._sequence, self.counted, self._strange = number, stood, 0
        self._other = number
        return number == self._sequence

    def take(self, number: int, sent: int, timeline: Timeline, now_s: float) -> bool:
        """Take a number that was read. Return whether it can belong to a sent segment.

        The first impossible number changes nothing; `STRANGE` in a row discard the reference.
        """
        if self._sequence is None:
            return False
        counted = self.counted + (number - self._sequence) % SEQUENCE_RANGE
        begun = counted == self.counted or (
            counted <= sent and timeline.begins(counted - 1) <= now_s + EARLY_S
        )
        if begun:
            self._sequence, self.counted, self._strange = number, counted, 0
            return True
        self._strange += 1
        if self._strange >= STRANGE:
            self.forget()
        return False


class ParameterScale:
    """Scale of the unit's segment parameter. It is not documented, so it is learnt during dwells.

    Attributes:
        full: the parameter at the end of a segment, or None while it is not known.
    """

    def __init__(self) -> None:
        self.full: float | None = None
        self._dwell: list[Position] = []
        self._dwells = 0

    @property
    def to_learn(self) -> bool:
        """Whether to learn the scale during the next dwell."""
        return self.full is None and self._dwells < ATTEMPTS

    def begin(self) -> None:
        """Begin a dwell."""
        self._dwell = []
        self._dwells += 1

    def stands(self, position: Position, dwell_ms: int) -> None:
        """Take a sample from a dwell of that length, in which the parameter rises linearly."""
        if self.full is not None:
            return
        self._dwell.append(position)
        found = [self._scale(a, b, dwell_ms) for a, b in pairwise(self._dwell[-3:])]
        if len(found) == 2 and min(found) > 0.0 and max(found) <= (1.0 + AGREE) * min(found):
            self.full = self._scale(self._dwell[-3], self._dwell[-1], dwell_ms)

    @staticmethod
    def _scale(a: Position, b: Position, dwell_ms: int) -> float:
        step_ms = (b.time_ms - a.time_ms) % CLOCK_RANGE_MS
        if a.segment != b.segment or not LEAST_STEP_MS <= step_ms <= dwell_ms:
            return 0.0
        return (b.parameter - a.parameter) / step_ms * dwell_ms

    def share(self, position: Position) -> float | None:
        """Return the fraction of the current segment that is done, 0 to 1, or None if it cannot be determined."""
        if self.full is None:
            return None
        share = position.parameter / self.full
        return min(share, 1.0) if 0.0 <= share <= 1.0 + AGREE else None
