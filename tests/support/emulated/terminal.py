"""A raw client of a pseudo-terminal."""

from __future__ import annotations

import os
import select
import time


class Terminal:
    """A raw client."""

    def __init__(self, path: str) -> None:
        self.descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY)

    def send(self, data: bytes) -> None:
        os.write(self.descriptor, data)

    def receive(self, ends: bytes, wall_s: float = 30.0) -> bytes:
        """Bytes until they end like that."""
        data, deadline = b"", time.monotonic() + wall_s
        while not data.endswith(ends) and time.monotonic() < deadline:
            if select.select([self.descriptor], [], [], 0.05)[0]:
                data += os.read(self.descriptor, 4096)
        return data

    def quiet(self, wall_s: float = 0.1) -> bool:
        return not select.select([self.descriptor], [], [], wall_s)[0]

    def close(self) -> None:
        os.close(self.descriptor)
