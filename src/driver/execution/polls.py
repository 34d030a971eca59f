"""Looks at a running stream: which were asked for, and what the statuses that came back mean together.

One answer may have a digit changed on the line, so a status that tells of a fault, or of a unit that is done, counts
when the next one says so too.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from driver.line.protocol import Status


@dataclass(frozen=True)
class Look:
    """One that was asked for.

    Attributes:
        sent, dwells: how many segments and dwells had been sent before.
        asked_s: when.
    """

    sent: int
    dwells: int
    asked_s: float


class Looks:
    """Position and status, asked for together and answered in order.

    Attributes:
        asked_at: when the last was asked for, whatever became of it; minus infinity lets the next one be now.
        idle: the last two statuses told of a unit that generates no motion.
        doubtful: the last status told of a fault; the next one decides.
    """

    def __init__(self) -> None:
        self.asked_at = -math.inf
        self.idle = False
        self.doubtful = False
        self._was_idle = False
        self._open: deque[Look] = deque()

    @property
    def oldest(self) -> Look | None:
        """That whose status has not come."""
        return self._open[0] if self._open else None

    def begin(self) -> None:
        """The unit was told to stand: what it was asked before tells nothing of now."""
        self._open.clear()
        self.idle = self._was_idle = False

    def ask(self, look: Look) -> None:
        """A look is asked for."""
        self._open.append(look)
        self.asked_at = look.asked_s

    def next_at(self, every_s: float, repeat_s: float, at_once: bool) -> float:
        """When to look again: after the one before was answered, or after `repeat_s` for it was lost."""
        if self._open:
            return self.asked_at + repeat_s
        return self.asked_at + (0.0 if at_once or self.doubtful else every_s)

    def take(self, status: Status) -> tuple[Look, Status]:
        """A status came: the look that it answers, and what to believe of it."""
        self.idle, self._was_idle = self._was_idle and not status.busy, not status.busy
        self.doubtful = status.fault and not self.doubtful
        look = self._open.popleft() if self._open else Look(0, 0, 0.0)
        return look, Status(0) if self.doubtful else status
