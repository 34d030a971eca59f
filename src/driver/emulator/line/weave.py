"""A byte echo: each byte is echoed as it arrives, so echoes and answers are interleaved."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from driver.line.protocol import BYTES_PER_SECOND

BYTES_PER_MS = BYTES_PER_SECOND / 1e3
_MOST_BYTES = 4096  # bytes waiting to be echoed; further ones are not echoed


class Weave:
    """Interleaves echoed bytes and answers on their way to the host.

    Args:
        mixed: whether echoes and answers alternate byte by byte; if not, an answer is sent as a whole.
        echoing: returns whether the unit echoes now.
        end: echo of a line feed.
    """

    def __init__(self, mixed: bool, echoing: Callable[[], bool], end: bytes) -> None:
        self._mixed = mixed
        self._echoing = echoing
        self._end = end
        self._arriving: deque[tuple[float, int]] = deque()  # time of arrival, byte
        self._echoes: deque[tuple[float, int]] = deque()  # earliest time to send, byte
        self._answers: deque[tuple[float, int]] = deque()
        self._free_at = 0.0
        self._answered_last = False

    def arrives(self, at_ms: float, byte: int) -> None:
        """Take a byte that arrives at that time."""
        if len(self._arriving) < _MOST_BYTES:
            self._arriving.append((at_ms, byte))

    def answer(self, at_ms: float, data: bytes) -> None:
        """Take an answer that may be sent from that time on."""
        self._answers.extend((at_ms, byte) for byte in data)

    def take(self, now_ms: float) -> bytes:
        """Return the bytes sent to the host since the last call."""
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
        """Return when the next byte is sent, or the next byte to echo arrives."""
        due = [] if not self._arriving else [self._arriving[0][0]]
        if self._echoes or self._answers:
            due.append(self._begins() + 1.0 / BYTES_PER_MS)
        return min(due, default=None)

    def forget(self) -> None:
        """Drop everything: the unit was switched off."""
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
