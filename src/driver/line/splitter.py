"""Split received bytes into lines that end in line feed, carriage return, or both."""

from __future__ import annotations

import re
from dataclasses import dataclass

_ENDS = re.compile(rb"(\r\n|\r|\n)")


@dataclass(frozen=True)
class Received:
    """A line without its end.

    Attributes:
        text: one character per byte.
        torn: the line before ended in a carriage return alone, although this unit ends lines in line feeds.
    """

    text: str
    torn: bool


class LineSplitter:
    """Splits a stream of bytes into lines.

    Args:
        longest: bytes; what has come of a longer line is dropped.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._rest = b""  # of an incomplete line
        self._after_return = False  # the last byte was a carriage return
        self._feeds = False  # lines end in LF or CR LF
        self._torn = False

    def take(self, data: bytes) -> list[Received]:
        """Take bytes and return the lines that they complete."""
        if not data:
            return []
        if self._after_return and data.startswith(b"\n"):
            data = data[1:]  # second half of CR LF
            self._feeds, self._torn = True, False
        self._after_return = data.endswith(b"\r")
        *parts, self._rest = _ENDS.split(self._rest + data)
        if len(self._rest) > self._longest:
            self._rest = b""
        found = []
        for line, end in zip(parts[::2], parts[1::2], strict=True):
            found.append(Received(line.decode("latin-1"), self._torn))
            self._feeds = self._feeds or end.endswith(b"\n")
            self._torn = self._feeds and end == b"\r"
        return found
