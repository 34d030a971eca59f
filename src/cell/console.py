"""Terminal output: lines, tables of 80 columns and progress bars, or one JSON object on standard output."""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TextIO

from arm.errors import ExecutionStopped

WIDTH = 80
TICK_S = 0.5  # period of the busy line; shorter work shows none
_LABEL, _BAR, _LEAST_BAR = 22, 30, 6


class OutputLost(ExecutionStopped):
    """Standard output can no longer be written. Raised once."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output: {error.strerror or error}", reason="output")


class Console:
    """Write text. The first failed write raises `OutputLost` (a closed pipe only in `heard`); later ones are lost.

    With `as_json`, standard output gets exactly one JSON object at the end; all other output goes to standard error.

    Attributes:
        listener: called with every line of `step` before it is written, or None.
    """

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json
        self._stream: TextIO | None = sys.stderr if as_json else sys.stdout  # None: closed at the start
        self._live = self._stream is not None and self._stream.isatty()
        self._open_line = False
        self._busy = ""  # text of the busy line
        self._bar_at = -math.inf  # when a progress bar was last drawn; it replaces the busy line
        self._lock = threading.Lock()
        self._lost: OSError | None = None
        self._needed = False
        self._started = time.monotonic()
        self.listener: Callable[[str], None] | None = None

    @contextlib.contextmanager
    def heard(self) -> Iterator[None]:
        """Require a reader inside the block, where the arm may move.

        Raises:
            OutputLost: the reader is gone.
        """
        if self._lost is not None:
            raise OutputLost(self._lost)
        self._needed = True
        try:
            yield
        finally:
            self._needed = False

    def say(self, text: str = "") -> None:
        """Write one line. Control characters are escaped."""
        self._write(f"{_harmless(text)}\n")

    def step(self, text: str) -> None:
        """Write one line with the wall time since the start, and pass it to the listener."""
        line = f"[{time.monotonic() - self._started:5.1f} s] {text}"
        if self.listener is not None:
            self.listener(line)
        self.say(line)

    def progress(self, text: str, fraction: float, hint: str = "") -> None:
        """Redraw a progress bar, followed by a hint. Terminals only."""
        if not self._live:
            return
        line = progress_line(text, fraction, hint, shutil.get_terminal_size((WIDTH, 24)).columns)
        self._bar_at = time.monotonic()
        self._write(f"\r{line}\x1b[K", open_line=True)

    @contextlib.contextmanager
    def doing(self, text: str) -> Iterator[None]:
        """Show a busy line with the elapsed time inside the block while nothing else is shown. Terminals only."""
        before, self._busy = self._busy, text
        if before or not self._live:
            try:
                yield
            finally:
                self._busy = before
            return
        over = threading.Event()
        ticking = threading.Thread(target=self._tick, args=(over,), daemon=True)
        ticking.start()
        try:
            yield
        finally:
            over.set()
            ticking.join(TICK_S)
            self._busy = ""
            self._end_progress()

    def _tick(self, over: threading.Event) -> None:
        began, what, stream = time.monotonic(), self._busy, self._stream
        while not over.wait(TICK_S):
            now = time.monotonic()
            if self._busy != what:
                began, what = now, self._busy
            if now - self._bar_at < 2.0 * TICK_S:
                continue
            columns = shutil.get_terminal_size((WIDTH, 24)).columns
            line = f"{what} ... {now - began:.0f} s"[: columns - 1]
            with self._lock:
                if over.is_set() or stream is None or self._stream is not stream:
                    return
                try:
                    stream.write(f"\r{line}\x1b[K")
                    stream.flush()
                except OSError:  # the next write reports it
                    return
                self._open_line = True

    def table(self, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Write a table with numbers right-aligned and text left-aligned."""
        for line in table_lines(header, rows):
            self.say(line)

    def result(self, value: dict[str, Any]) -> None:
        """Write the JSON object if `as_json` is set."""
        self._end_progress()
        if self.as_json and sys.stdout is not None:
            self._stream = sys.stdout
            self._write(json.dumps(value, indent=2, allow_nan=False) + "\n")

    def _end_progress(self) -> None:
        if self._open_line:
            self._write("")

    def _write(self, text: str, open_line: bool = False) -> None:
        with self._lock:
            stream = self._stream
            if stream is None:
                return
            ended, self._open_line = self._open_line and not open_line, open_line
            try:
                stream.write(f"\r\x1b[K{text}" if ended else text)
                stream.flush()
            except OSError as error:
                self._stream, self._live, self._lost = None, False, error
                _silence(stream)
                if self._needed or not isinstance(error, BrokenPipeError):
                    raise OutputLost(error) from error


def say_on_stderr(text: str) -> None:
    """Write one line to standard error. Ignore a failed write: the exit code reports the outcome too."""
    if sys.stderr is None:
        return
    try:
        sys.stderr.write(f"{_harmless(text)}\n")
        sys.stderr.flush()
    except OSError:
        _silence(sys.stderr)


def _harmless(text: str) -> str:
    """Escape control characters: names come from files of any origin."""
    return "".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text)


def _silence(stream: TextIO) -> None:
    """Discard further output to a lost stream, including what it flushes when the interpreter exits."""
    with contextlib.suppress(OSError, ValueError):  # not backed by a file
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def progress_line(text: str, fraction: float, hint: str, columns: int) -> str:
    """Return a line of at most `columns` - 1 characters: text, a bar if there is room, percentage, hint."""
    part = min(max(fraction, 0.0), 1.0)
    tail = f"{100 * part:4.0f} %" + (f"  {hint}" if hint else "")
    room = columns - 1 - len(tail) - 1
    bar = min(room - max(_LABEL, len(text)) - 1, _BAR)
    if bar < _LEAST_BAR:
        return f"{text[: max(room, 0)]:<{max(room, 0)}} {tail}"[: columns - 1]
    done = round(bar * part)
    label = room - bar - 1
    return f"{text:<{label}} {'#' * done}{'.' * (bar - done)} {tail}"


def table_lines(header: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return the lines of a table."""
    texts = [[_text(value) for value in row] for row in rows]
    numeric = (
        [all(isinstance(row[i], int | float) or row[i] is None for row in rows) for i in range(len(header))]
        if isinstance(rows, Sequence)
        else [False] * len(header)
    )
    widths = [max(len(h), *(len(row[i]) for row in texts)) if texts else len(h) for i, h in enumerate(header)]

    def line(cells: Sequence[str]) -> str:
        return "  ".join(
            c.rjust(w) if right else c.ljust(w) for c, w, right in zip(cells, widths, numeric, strict=True)
        ).rstrip()

    return [line(header), line(["-" * w for w in widths]), *(line(row) for row in texts)]


def _plain(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def _text(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3f}" if isinstance(value, float) and abs(value) < 0.1 else _plain(value)
