"""A serial line in memory, in stepped time: the driver's port at one end, an emulated unit at the other."""

from __future__ import annotations

import functools
from collections.abc import Callable

from driver.emulator.line.uart import Wire
from driver.line.stepped_clock import SteppedClock

Tap = Callable[[float, bytes], bytes]  # what becomes of bytes that pass at that time, s


class MemoryLine:
    """Carries bytes both ways, each `latency_s` later, in order. Its unit paces them as a real line does (`Wire`).

    To the driver it is a `driver.line.port.Port`; the unit calls `read`, `reply`, `waiting` and `hang_up`.

    Args:
        clock: of both ends.
        latency_s: one way, as of a USB adapter or a network.
        to_unit, to_host: damage to the line, if any: each is called with the time and the bytes as they are sent, and
            gives the bytes that go.

    Attributes:
        url: a name for messages.
        sent, received: all bytes that the host has sent and received, with their times there, s.
    """

    url = "memory line"

    def __init__(
        self,
        clock: SteppedClock,
        latency_s: float = 0.0,
        to_unit: Tap | None = None,
        to_host: Tap | None = None,
    ) -> None:
        self.clock = clock
        self.latency_s = latency_s
        self.to_unit = to_unit
        self.to_host = to_host
        self.sent: list[tuple[float, bytes]] = []
        self.received: list[tuple[float, bytes]] = []
        self._at_unit = bytearray()  # arrived there, not yet read
        self._gone = False
        self._deliver: Callable[[bytes], None] | None = None
        self._lose: Callable[[OSError], None] | None = None

    # -- the host's end

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Hand over what arrives, and tell when the line is gone."""
        self._deliver, self._lose = deliver, lose

    @property
    def out_waiting(self) -> int:
        """Bytes that the unit holds back."""
        return len(self._at_unit)

    def write(self, data: bytes) -> None:
        """Send bytes to the unit.

        Raises:
            OSError: the line is gone.
        """
        if self._gone:
            raise OSError("the line is gone")
        now = self.clock.now()
        self.sent.append((now, data))
        if self.to_unit is not None:
            data = self.to_unit(now, data)
        self.clock.call_at(now + self.latency_s, functools.partial(self._at_unit.extend, data))

    def reset_output_buffer(self) -> None:
        """Drop what the unit holds back; what is on its way goes on."""
        self._at_unit.clear()

    def close(self) -> None:
        """The host listens no more."""
        self._deliver = self._lose = None

    # -- the unit's end

    def waiting(self) -> int:
        """Bytes to read."""
        return len(self._at_unit)

    def read(self, size: int) -> bytes:
        """Bytes that have arrived, at most that many.

        Raises:
            BlockingIOError: none.
        """
        if not self._at_unit:
            raise BlockingIOError
        data = bytes(self._at_unit[:size])
        del self._at_unit[:size]
        return data

    def reply(self, data: bytes) -> None:
        """Send bytes to the host."""
        now = self.clock.now()
        if self.to_host is not None:
            data = self.to_host(now, data)
        if data and not self._gone:
            self.clock.call_at(now + self.latency_s, functools.partial(self._arrive, data))

    def hang_up(self) -> None:
        """The line is gone; what is on its way to the host still arrives."""
        self._gone = True
        self._at_unit.clear()
        end = functools.partial(self._end, OSError("closed by the other side"))
        self.clock.call_at(self.clock.now() + self.latency_s, end)

    def _arrive(self, data: bytes) -> None:
        self.received.append((self.clock.now(), data))
        if self._deliver is not None:
            try:
                self._deliver(data)
            except OSError as error:
                self._end(error)

    def _end(self, error: OSError) -> None:
        if self._lose is not None:
            self._lose(error)
        self._deliver = self._lose = None


class MemoryWire(Wire):
    """The unit's end of a `MemoryLine`."""

    def __init__(self, line: MemoryLine, paced: bool) -> None:
        super().__init__(-1, paced)
        self.line = line

    def _read(self, size: int) -> bytes:
        return self.line.read(size)

    def _write(self, data: bytes) -> None:
        self.line.reply(data)

    def waiting(self) -> int:
        """Bytes that can be read."""
        return self.line.waiting()
