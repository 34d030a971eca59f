"""Received bytes to lines, whatever ends them: line feed, carriage return, or both."""

from __future__ import annotations

import re
from dataclasses import dataclass

_ENDS = re.compile(rb"(\r\n|\r|\n)")


@dataclass(frozen=True)
class Received:
    """A line without its end.

    Attributes:
        text: one character a byte.
        torn: the line before ended in a carriage return alone, and lines of this unit end in line feeds.
    """

    text: str
    torn: bool


class LineSplitter:
    """Takes bytes as they come.

    Args:
        longest: bytes; a line that is longer is dropped as far as it has come.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._rest = b""  # of a line that is not complete
        self._after_return = False  # the last byte was a carriage return
        self._feeds = False  # lines end in line feeds, after a carriage return or without
        self._torn = False

    def take(self, data: bytes) -> list[Received]:
        """The lines that are complete by now."""
        if not data:
            return []
        if self._after_return and data.startswith(b"\n"):
            data = data[1:]  # the second half of one end
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
