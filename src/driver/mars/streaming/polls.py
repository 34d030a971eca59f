"""Polls of a running stream: which are pending, and how to interpret the statuses received.

The line may damage a digit of an answer. So a status that shows a fault or an idle unit counts only if the next one
confirms it.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

from driver.line.protocol import Status


@dataclass(frozen=True)
class Poll:
    """One poll.

    Attributes:
        sent, dwells: how many segments and dwells had been sent before the poll.
        asked_s: when it was sent.
    """

    sent: int
    dwells: int
    asked_s: float


class Polls:
    """Polls of position and status, asked together and answered in order.

    Attributes:
        asked_at: when the last poll was sent, answered or not; minus infinity makes the next one due now.
        sent_at: when the last poll was sent.
        idle: the last two statuses show a unit that generates no motion.
        doubtful: the last status shows a fault; the next one decides.
    """

    def __init__(self) -> None:
        self.asked_at = -math.inf
        self.sent_at = 0.0
        self.idle = False
        self.doubtful = False
        self._was_idle = False
        self._open: deque[Poll] = deque()

    @property
    def oldest(self) -> Poll | None:
        """Oldest poll without a status, or None."""
        return self._open[0] if self._open else None

    def begin(self) -> None:
        """Forget all polls: a dwell was sent, so earlier ones no longer apply."""
        self._open.clear()
        self.idle = self._was_idle = False

    def ask(self, poll: Poll) -> None:
        """Record a poll that is sent."""
        self._open.append(poll)
        self.asked_at = self.sent_at = poll.asked_s

    def next_at(self, every_s: float, repeat_s: float, at_once: bool) -> float:
        """Return when to poll again: after the last poll is answered, or after `repeat_s` as it may be lost."""
        if self._open:
            return self.asked_at + repeat_s
        return self.asked_at + (0.0 if at_once or self.doubtful else every_s)

    def take(self, status: Status) -> tuple[Poll, Status]:
        """Match a status with its poll. Return that poll, and the status without an unconfirmed fault."""
        self.idle, self._was_idle = self._was_idle and not status.busy, not status.busy
        self.doubtful = status.fault and not self.doubtful
        poll = self._open.popleft() if self._open else Poll(0, 0, 0.0)
        return poll, Status(0) if self.doubtful else status
