"""A raw client of an emulated unit: bytes out, bytes in, by pseudo-terminal, TCP, or a line in stepped time."""

from __future__ import annotations

import os
import queue
import select
import socket
import time

from driver.emulator.line.memory import MemoryLine


class SteppedClient:
    """As `Client`, at the host's end of a line in memory; its times are those of the line's clock, s."""

    def __init__(self, line: MemoryLine) -> None:
        self.line = line
        self._inbox: queue.SimpleQueue[bytes | OSError] = queue.SimpleQueue()
        line.listen(self._inbox.put, self._inbox.put)

    def send(self, *lines: str) -> None:
        """Lines, each with its end, in one write."""
        self.write("".join(line + "\n" for line in lines).encode("latin-1"))

    def write(self, data: bytes) -> None:
        self.line.write(data)

    def read_until(self, ends: bytes, within_s: float = 200.0) -> bytes:
        """Bytes until they end like that; what has come so far if they do not in time."""
        until = self.line.clock.now() + within_s
        data = b""
        while not data.endswith(ends):
            try:
                item = self.line.clock.next_of(self._inbox, until)
            except queue.Empty:
                break
            if isinstance(item, OSError):
                raise item
            data += item
        return data

    def ask(self, line: str) -> str:
        """The one line that answers it."""
        self.send(line)
        return self.read_until(b"\n").decode("latin-1").strip()

    def read_for(self, seconds: float) -> bytes:
        """Whatever comes within a time."""
        return self.read_until(b"never, for sure", seconds)

    def wait_for(self, condition: object, within_s: float = 200.0) -> None:
        """Until a function says yes; it must within that time."""
        assert callable(condition)
        until = self.line.clock.now() + within_s
        while not condition():
            assert self.line.clock.now() < until, "not in time"
            self.line.clock.sleep(0.005)

    def close(self) -> None:
        self.line.close()

    def __enter__(self) -> SteppedClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Client:
    """Opens a device path or a ``socket://host:port``."""

    def __init__(self, url: str) -> None:
        self._socket: socket.socket | None = None
        if url.startswith("socket://"):
            host, port = url.removeprefix("socket://").split(":")
            self._socket = socket.create_connection((host, int(port)), timeout=600.0)
            self._socket.settimeout(None)  # reads are guarded by select
            self.descriptor = self._socket.fileno()
        else:
            self.descriptor = os.open(url, os.O_RDWR | os.O_NOCTTY)

    def send(self, *lines: str) -> None:
        """Lines, each with its end, in one write."""
        self.write("".join(line + "\n" for line in lines).encode("latin-1"))

    def write(self, data: bytes) -> None:
        os.write(self.descriptor, data)

    def write_all(self, data: bytes) -> None:
        """However long the other side takes."""
        while data:
            data = data[os.write(self.descriptor, data) :]

    def drain_until(self, ends: bytes, wall_s: float) -> bytes:
        """As `read_until`, but only the newest bytes are kept."""
        data, deadline = b"", time.monotonic() + wall_s
        while ends not in data and time.monotonic() < deadline:
            if select.select([self.descriptor], [], [], 0.05)[0]:
                data = (data + os.read(self.descriptor, 65536))[-70_000:]
        return data

    def read_until(self, ends: bytes, wall_s: float = 60.0) -> bytes:
        """Bytes until they end like that; what has come so far if they do not in time."""
        data, deadline = b"", time.monotonic() + wall_s
        while not data.endswith(ends) and time.monotonic() < deadline:
            if select.select([self.descriptor], [], [], 0.05)[0]:
                more = os.read(self.descriptor, 4096)
                if not more:
                    raise OSError("closed by the other side")
                data += more
        return data

    def ask(self, line: str) -> str:
        """The one line that answers it."""
        self.send(line)
        return self.read_until(b"\n").decode("latin-1").strip()

    def read_for(self, wall_s: float) -> bytes:
        """Whatever comes within a time."""
        return self.read_until(b"never, for sure", wall_s)

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()
        else:
            os.close(self.descriptor)

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def wait_for(condition: object, wall_s: float = 60.0) -> None:
    """Until a function says yes; it must within that wall time."""
    assert callable(condition)
    deadline = time.monotonic() + wall_s
    while not condition():
        assert time.monotonic() < deadline, "not in time"
        time.sleep(0.002)
