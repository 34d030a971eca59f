"""One end of a serial line at 19200 baud in emulated time: when a line is received, and when an answer is sent."""

from __future__ import annotations

import contextlib
import math
import os
from collections import deque
from collections.abc import Callable

from driver.emulator.line.weave import BYTES_PER_MS, Weave
from driver.emulator.options import EmulatorOptions

_AHEAD_BYTES = 64  # bytes read before the line would have carried them; the rest waits at the host
_LONGEST = 1024  # bytes; a longer line is noise
_BACKLOG_BYTES = 4096  # bytes of unsent answers, beyond which the unit blocks the host, as by RTS


class Wire:
    """Paces one client's bytes. Times are emulated ms. The number of bytes held is bounded.

    Args:
        descriptor: of the pseudo-terminal's master or of a socket, non-blocking.
        options: `paced`, the echo and the input buffer are used.
        echoing: returns whether the unit echoes now; for a byte echo.

    Attributes:
        fresh: no line has been taken yet.
        heard: a byte has been received.
        gone: the client has left; its bytes may still be on the line.
        cut: the port is gone; no bytes pass.
        busy_until: the unit executes a line until then, and takes no other.
    """

    def __init__(
        self, descriptor: int, options: EmulatorOptions, echoing: Callable[[], bool] = lambda: True
    ) -> None:
        self.descriptor = descriptor
        self._paced, self._adapter_echo = options.paced, options.adapter_echo
        self._buffer, self._drops = options.input_buffer, options.input_full == "drop"
        self._weave: Weave | None = None
        if options.echo == "byte":
            self._weave = Weave(options.echo_order == "mixed", echoing, options.echoed_end)
        self._held = 0  # bytes received and not yet executed
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

    def wants_bytes(self, now_ms: float) -> bool:
        """Whether the line has carried most of what was read, and the backlog of answers is not full."""
        room = not self._full and self._backlog < _BACKLOG_BYTES
        return room and (self._received_until - now_ms) * BYTES_PER_MS < _AHEAD_BYTES

    @property
    def _full(self) -> bool:
        """Whether a full input buffer blocks the host."""
        return 0 < self._buffer <= self._held and not self._drops

    def room_at(self) -> float:
        """Return when `wants_bytes` may be true again."""
        if self._backlog >= _BACKLOG_BYTES:
            return self._answers[0][0]
        if self._full:
            return self.next_line_at() or math.inf
        return self._received_until - (_AHEAD_BYTES - 1) / BYTES_PER_MS

    def receive(self, now_ms: float) -> bool:
        """Read what there is. Return False if the client of a socket has left."""
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
        """Read at most `size` bytes of the client; raises BlockingIOError if there are none."""
        return os.read(self.descriptor, size)

    def _write(self, data: bytes) -> None:
        """Write bytes to the client."""
        os.write(self.descriptor, data)

    def waiting(self) -> int:
        """Return the number of bytes to read if known without `select`; 0 otherwise."""
        return 0

    def _time(self, size: int) -> float:
        return size / BYTES_PER_MS if self._paced else 0.0

    def next_line_at(self) -> float | None:
        """Return when the next received line is complete and can be executed."""
        return max(self._lines[0][0], self.busy_until) if self._lines else None

    def take_line(self) -> tuple[float, bytes, bool]:
        """Remove the next received line. Return when it was complete, its bytes, and whether it was put back before."""
        line = self._lines.popleft()
        if not line[2]:
            self._held -= len(line[1])
        return line

    def put_back(self, at_ms: float, data: bytes) -> None:
        """Put back a line that is to come later; those behind it wait."""
        self._lines.appendleft((at_ms, data, True))

    def assemble(self, data: bytes) -> list[bytes]:
        """Return the complete lines, with their ends. A line that has lost its end runs into the next."""
        *lines, rest = (self._torn + data).split(b"\n")
        self._torn = rest[-_LONGEST:]
        return [line + b"\n" for line in lines]

    def forget(self) -> None:
        """Drop everything received and all pending answers: the unit was switched off."""
        self._lines.clear()
        self._answers.clear()
        self._partial, self._torn, self._backlog, self._held = b"", b"", 0, 0
        if self._weave is not None:
            self._weave.forget()

    def answer(self, data: bytes, now_ms: float, late_ms: float = 0.0) -> None:
        """Queue bytes to the client, which the line carries in order."""
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
        """Return when the next answer is sent completely."""
        if self._weave is not None:
            return self._weave.next_at()
        return self._answers[0][0] if self._answers else None

    def flush(self, now_ms: float) -> None:
        """Write the answers that are due, one write per line. Bytes that the client does not read are lost."""
        if self._weave is not None and (data := self._weave.take(now_ms)):
            with contextlib.suppress(OSError):
                self._write(data)
        while self._answers and self._answers[0][0] <= now_ms:
            _, data = self._answers.popleft()
            self._backlog -= len(data)
            with contextlib.suppress(OSError):  # full, or the client has gone
                self._write(data)
