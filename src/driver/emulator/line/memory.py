"""A serial line in memory, in stepped time: the driver at one end, an emulated unit at the other."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field

from driver.emulator.line.uart import Wire
from driver.emulator.options import EmulatorOptions
from driver.line.stepped_clock import SteppedClock

Tap = Callable[[float, bytes], bytes]  # from time, s, and bytes sent to the bytes that pass


@dataclass(eq=False)
class MemoryLine:
    """Carries bytes both ways, in order, with a delay of `latency_s`. The unit paces them by the baud rate (`Wire`).

    To the driver it is a `driver.line.port.Port`; the unit calls `read`, `reply`, `waiting` and `hang_up`.

    Attributes:
        url: a name for messages.
        clock: of both ends.
        latency_s: one way, as of a USB adapter or a network.
        to_unit, to_host: damage to the line, if any: called with the time and the bytes sent, returns the bytes that
            pass.
        sent, received: all bytes that the host has sent and received, with the host's times, s.
    """

    url = "memory line"

    clock: SteppedClock
    latency_s: float = 0.0
    to_unit: Tap | None = None
    to_host: Tap | None = None
    sent: list[tuple[float, bytes]] = field(default_factory=list)
    received: list[tuple[float, bytes]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._at_unit = bytearray()  # arrived at the unit, not yet read
        self._gone = False
        self._deliver: Callable[[bytes], None] | None = None
        self._lose: Callable[[OSError], None] | None = None

    # -- the host's end

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Pass what arrives to `deliver`, and call `lose` when the line is gone."""
        self._deliver, self._lose = deliver, lose

    @property
    def out_waiting(self) -> int:
        """Bytes that the unit has not read."""
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
        """Drop the bytes that the unit has not read, except those still on their way."""
        self._at_unit.clear()

    def close(self) -> None:
        """Stop listening at the host's end."""
        self._deliver = self._lose = None

    # -- the unit's end

    def waiting(self) -> int:
        """Return the number of bytes to read."""
        return len(self._at_unit)

    def read(self, size: int) -> bytes:
        """Read at most `size` bytes that have arrived.

        Raises:
            BlockingIOError: there are none.
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
        """Close the line from the unit's end. Bytes on their way to the host still arrive."""
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

    def __init__(self, line: MemoryLine, options: EmulatorOptions, echoing: Callable[[], bool]) -> None:
        super().__init__(-1, options, echoing)
        self.line = line

    def _read(self, size: int) -> bytes:
        return self.line.read(size)

    def _write(self, data: bytes) -> None:
        self.line.reply(data)

    def waiting(self) -> int:
        """Return the number of bytes to read."""
        return self.line.waiting()
