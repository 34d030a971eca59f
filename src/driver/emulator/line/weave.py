"""An echo byte by byte: each byte goes back as it arrives, so answers come between them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

BYTES_PER_MS = 1.92  # 19200 baud, 8N1
_MOST_BYTES = 4096  # waiting to be echoed; a unit that is flooded echoes no more


class Weave:
    """What one line carries to the host: echoed bytes and answers, one byte after the other.

    Args:
        mixed: echoes and answers take turns byte by byte; else an answer goes whole, where it falls.
        echoing: whether the unit echoes now.
        end: what a line feed comes back as.
    """

    def __init__(self, mixed: bool, echoing: Callable[[], bool], end: bytes) -> None:
        self._mixed = mixed
        self._echoing = echoing
        self._end = end
        self._arriving: deque[tuple[float, int]] = deque()  # when it arrives, byte
        self._echoes: deque[tuple[float, int]] = deque()  # from when it may go, byte
        self._answers: deque[tuple[float, int]] = deque()
        self._free_at = 0.0
        self._answered_last = False

    def arrives(self, at_ms: float, byte: int) -> None:
        """A byte is through the line at that time."""
        if len(self._arriving) < _MOST_BYTES:
            self._arriving.append((at_ms, byte))

    def answer(self, at_ms: float, data: bytes) -> None:
        """The unit has something to say from then on."""
        self._answers.extend((at_ms, byte) for byte in data)

    def take(self, now_ms: float) -> bytes:
        """What has gone to the host by now, and was not yet taken."""
        out = bytearray()
        while True:
            while self._arriving and self._arriving[0][0] <= now_ms:
                at, byte = self._arriving.popleft()
                if self._echoing():
                    self._echoes.extend((at, b) for b in (self._end if byte == 0x0A else bytes([byte])))
            begins = self._begins()
            if begins + 1.0 / BYTES_PER_MS > now_ms:
                return bytes(out)
            out.append(self._next(begins))
            self._free_at = begins + 1.0 / BYTES_PER_MS

    def next_at(self) -> float | None:
        """When the next byte may be through, or something arrives that is echoed."""
        due = [] if not self._arriving else [self._arriving[0][0]]
        if self._echoes or self._answers:
            due.append(self._begins() + 1.0 / BYTES_PER_MS)
        return min(due, default=None)

    def forget(self) -> None:
        """The unit was switched off."""
        for each in (self._arriving, self._echoes, self._answers):
            each.clear()

    def _begins(self) -> float:
        heads = [queue[0][0] for queue in (self._echoes, self._answers) if queue]
        return max(self._free_at, min(heads)) if heads else float("inf")

    def _next(self, at_ms: float) -> int:
        ready = [bool(q) and q[0][0] <= at_ms for q in (self._echoes, self._answers)]
        if all(ready):
            first = self._answers[0][0] <= self._echoes[0][0]
            answers = not self._answered_last if self._mixed else (self._answered_last or first)
        else:
            answers = ready[1]
        self._answered_last = answers
        return (self._answers if answers else self._echoes).popleft()[1]
