"""One end of a serial line at 19200 baud in emulated time: when a received line is complete, when an answer is out."""

from __future__ import annotations

import contextlib
import math
import os
from collections import deque

from driver.emulator.line.weave import BYTES_PER_MS, Weave

_AHEAD_BYTES = 64  # read from the host before the line would have carried them; the rest waits in the host
_LONGEST = 1024  # a line this long is noise
_BACKLOG_BYTES = 4096  # answers not yet sent; beyond, the unit holds the host back as RTS does


class Wire:
    """Paces one client's bytes. Times are emulated ms. Holds a bounded number of bytes, whatever the client does.

    Args:
        descriptor: of the pseudo-terminal's master or of a socket, non-blocking.
        paced: False: bytes take no time.

    Attributes:
        fresh: no line has been taken yet.
        heard: a byte has been received.
        gone: the client has left; what it sent may still be on the line.
        cut: the port is gone: nothing comes or goes any more.
        busy_until: the unit obeys a line until then, and takes no other.
    """

    def __init__(self, descriptor: int, paced: bool) -> None:
        self.descriptor = descriptor
        self._paced = paced
        self._weave: Weave | None = None
        self._adapter_echo = False
        self._buffer, self._drops = 0, False
        self._held = 0  # bytes received and not yet obeyed
        self._partial = b""
        self._torn = b""
        self._received_until = 0.0
        self._sent_until = 0.0
        self._lines: deque[tuple[float, bytes, bool]] = deque()
        self._answers: deque[tuple[float, bytes]] = deque()
        self._backlog = 0
        self.fresh = True
        self.heard = False
        self.gone = False
        self.cut = False
        self.busy_until = 0.0

    def equip(self, weave: Weave | None, adapter_echo: bool, buffer: int, drops: bool) -> None:
        """Give the line what units differ in.

        Args:
            weave: carries what goes to the host, if the unit echoes byte by byte.
            adapter_echo: everything is sent back at once.
            buffer: bytes that the unit holds before it has obeyed them; 0 is any number.
            drops: bytes beyond that are lost; else the host is held back.
        """
        self._weave, self._adapter_echo = weave, adapter_echo
        self._buffer, self._drops = buffer, drops

    def wants_bytes(self, now_ms: float) -> bool:
        """Whether the line has carried what was read so far, and answers are not piling up."""
        if self._buffer and not self._drops and self._held >= self._buffer:
            return False
        return (
            self._backlog < _BACKLOG_BYTES and (self._received_until - now_ms) * BYTES_PER_MS < _AHEAD_BYTES
        )

    def room_at(self) -> float:
        """When `wants_bytes` may be true again."""
        if self._backlog >= _BACKLOG_BYTES:
            return self._answers[0][0]
        if self._buffer and not self._drops and self._held >= self._buffer:
            return self.next_line_at() or math.inf
        return self._received_until - (_AHEAD_BYTES - 1) / BYTES_PER_MS

    def receive(self, now_ms: float) -> bool:
        """Read what there is; False if the client has gone (a socket's)."""
        try:
            data = self._read(_AHEAD_BYTES)
        except BlockingIOError:
            return True
        except OSError:
            return False
        if not data:
            return False
        self.heard = True
        if self._adapter_echo:
            self.answer(data, now_ms)
        if self._buffer and self._drops:
            data = data[: max(self._buffer - self._held, 0)]
        self._held += len(data)
        begin = max(self._received_until, now_ms)
        if self._weave is not None:
            for number, byte in enumerate(data, start=1):
                self._weave.arrives(begin + self._time(number), byte)
        *lines, rest = data.split(b"\n")
        for line in lines:
            begin += self._time(len(line) + 1)
            self._lines.append((begin, self._partial + line + b"\n", False))
            self._partial = b""
        self._received_until = begin + self._time(len(rest))
        self._partial += rest
        self._held -= max(len(self._partial) - _LONGEST, 0)
        self._partial = self._partial[-_LONGEST:]
        return True

    def _read(self, size: int) -> bytes:
        """What there is of the client's bytes, at most that many; raises BlockingIOError if nothing."""
        return os.read(self.descriptor, size)

    def _write(self, data: bytes) -> None:
        """Bytes that the line has carried, to the client."""
        os.write(self.descriptor, data)

    def waiting(self) -> int:
        """Bytes that can be read, where that can be told without `select`; else 0."""
        return 0

    def _time(self, size: int) -> float:
        return size / BYTES_PER_MS if self._paced else 0.0

    def next_line_at(self) -> float | None:
        """When the next received line is complete."""
        return max(self._lines[0][0], self.busy_until) if self._lines else None

    def take_line(self) -> tuple[float, bytes, bool]:
        """The next received line with its end: when it was complete, and whether it was put back before."""
        line = self._lines.popleft()
        if not line[2]:
            self._held -= len(line[1])
        return line

    def put_back(self, at_ms: float, data: bytes) -> None:
        """A line that comes later than it was sent; those behind it wait."""
        self._lines.appendleft((at_ms, data, True))

    def assemble(self, data: bytes) -> list[bytes]:
        """Whole lines, with their ends, from what arrived; a line that has lost its end runs into the next."""
        *lines, rest = (self._torn + data).split(b"\n")
        self._torn = rest[-_LONGEST:]
        return [line + b"\n" for line in lines]

    def forget(self) -> None:
        """The unit was switched off: what it received and what it had to say is lost."""
        self._lines.clear()
        self._answers.clear()
        self._partial, self._torn, self._backlog, self._held = b"", b"", 0, 0
        if self._weave is not None:
            self._weave.forget()

    def answer(self, data: bytes, now_ms: float, late_ms: float = 0.0) -> None:
        """Send when the line has carried it; order is kept."""
        if self.cut:
            return
        if self._weave is not None:
            self._weave.answer(now_ms + late_ms, data)
            return
        self._sent_until = max(self._sent_until, now_ms) + self._time(len(data))
        before = self._answers[-1][0] if self._answers else 0.0
        self._answers.append((max(self._sent_until + late_ms, before), data))
        self._backlog += len(data)

    def next_answer_at(self) -> float | None:
        """When the next answer is through."""
        if self._weave is not None:
            return self._weave.next_at()
        return self._answers[0][0] if self._answers else None

    def flush(self, now_ms: float) -> None:
        """Write every answer that is through, one write a line. What nobody reads is lost, as on a real line."""
        if self._weave is not None and (data := self._weave.take(now_ms)):
            with contextlib.suppress(OSError):
                self._write(data)
        while self._answers and self._answers[0][0] <= now_ms:
            _, data = self._answers.popleft()
            self._backlog -= len(data)
            try:
                self._write(data)
            except OSError:  # full, or the client has gone
                continue
