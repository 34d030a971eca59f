"""Which of the segments sent the unit executes, and how far it is in it: from its own numbers in COORDAP.

An answer may be damaged on the line, so no number is believed that the unit could not have reached by then.
"""

from __future__ import annotations

from itertools import pairwise

from driver.line.protocol import CLOCK_RANGE_MS, SEQUENCE_RANGE, Position
from driver.mars.lookahead import Timeline

EARLY_S = 0.05  # by which a unit may be ahead of what the line's rate allows
STRANGE = 2  # numbers in a row that cannot be: then the one that they were counted from was damaged
LEAST_STEP_MS = 40  # between two samples that tell the parameter's scale
ATTEMPTS = 3  # dwells, after which a unit does not tell
AGREE = 0.1  # between two such scales


class Running:
    """Counts segments by the unit's numbers.

    Attributes:
        known: the number of some segment is known.
        counted: how many of the segments sent have begun.
    """

    def __init__(self) -> None:
        self.counted = 0
        self._sequence: int | None = None  # the unit's number of the segment `counted`
        self._strange = 0
        self._other: int | None = None  # told last in a dwell

    @property
    def known(self) -> bool:
        return self._sequence is not None

    def forget(self) -> None:
        """What runs next has a number that is not known."""
        self._sequence, self._strange, self._other = None, 0, None

    def stands(self, number: int, stood: int) -> bool:
        """The unit stands behind `stood` segments, in a dwell of that number; whether that is what it told before.

        Of two numbers one is damaged; that which comes twice in a row is right.
        """
        if self._sequence is None or number == self._other:
            self._sequence, self.counted, self._strange = number, stood, 0
        self._other = number
        return number == self._sequence

    def take(self, number: int, sent: int, timeline: Timeline, now_s: float) -> bool:
        """A number that was told; whether it can be that of a segment sent. Else nothing changes, at first."""
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
    """What the unit's parameter of a segment counts to. Its scale is not documented, so it is learnt in dwells.

    Attributes:
        full: the parameter at the end of a segment, or None while that is not known.
    """

    def __init__(self) -> None:
        self.full: float | None = None
        self._dwell: list[Position] = []
        self._dwells = 0

    @property
    def to_learn(self) -> bool:
        """It may be learnt from a dwell that is long enough."""
        return self.full is None and self._dwells < ATTEMPTS

    def begin(self) -> None:
        """A dwell begins."""
        self._dwell = []
        self._dwells += 1

    def stands(self, position: Position, dwell_ms: int) -> None:
        """A sample from within a dwell of that length: its parameter rises evenly."""
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
        """How far the segment that runs is done, 0 to 1, or None if that cannot be told."""
        if self.full is None:
            return None
        share = position.parameter / self.full
        return min(share, 1.0) if 0.0 <= share <= 1.0 + AGREE else None
