"""Terminal output: lines, tables and progress, or one JSON object on standard output.

rich lays out tables and progress; it is loaded when the first is shown. Tables are plain text. In a file or a pipe they
are as wide as they need to be; on a terminal they are wrapped at its width. Progress is one line at the bottom of a
terminal, on standard error.
"""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TextIO

from arm.credentials import hide_credentials
from arm.errors import ExecutionStopped

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.live import Live

WIDTH = 80
TICK_S = 0.5  # shorter work shows no busy line
_REDRAWS = 10  # per second, of the progress line
_UNBOUNDED = 100_000  # width of a table that is not wrapped


class OutputLost(ExecutionStopped):
    """Standard output can no longer be written. Raised once."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output: {error.strerror or error}", reason="output")


class Console:
    """Write text to the terminal, a file or a pipe.

    The first write that fails raises `OutputLost`; a closed pipe does so only inside `heard`. Later writes are ignored.
    With `as_json`, standard output gets one JSON object at the end; everything else goes to standard error.

    Attributes:
        listener: called with every line of `step` before it is written, or None.
    """

    _lock: ClassVar = threading.RLock()
    _line: ClassVar[Live | None] = None  # the progress line that is shown; there is one terminal

    def __init__(self, as_json: bool = False) -> None:
        self.as_json = as_json
        self._stream: TextIO | None = sys.stderr if as_json else sys.stdout  # None: closed at the start
        self._terminal = self._stream is not None and self._stream.isatty()
        self._busy, self._busy_s = "", 0.0  # text of the busy line, and since when
        self._bar: RenderableType = ""
        self._bar_s = -math.inf  # when the bar or a line was last written: the busy line waits after it
        self._lost: OSError | None = None
        self._needed = False
        self._warned: set[str] = set()
        self._started = time.monotonic()
        self.listener: Callable[[str], None] | None = None

    @property
    def at_terminal(self) -> bool:
        """Whether progress is shown."""
        return self._terminal

    @contextlib.contextmanager
    def heard(self) -> Iterator[None]:
        """Inside the block, where the arm may move, require that somebody reads the output.

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

    def warn(self, text: str, about: str) -> None:
        """Write a warning; of those about the same subject only the first."""
        if about not in self._warned:
            self._warned.add(about)
            self.say(f"WARNING: {text}")

    def step(self, text: str) -> None:
        """Write one line with the wall time since the start, and pass it to the listener."""
        line = f"[{time.monotonic() - self._started:5.1f} s] {text}"
        if self.listener is not None:
            self.listener(line)
        self.say(line)

    def progress(self, text: str, fraction: float, hint: str = "") -> None:
        """Show a progress bar, followed by a hint. Terminals only."""
        if self._terminal:
            self._bar, self._bar_s = progress_bar(text, fraction, hint), time.monotonic()
            self._show_progress()

    @contextlib.contextmanager
    def doing(self, text: str) -> Iterator[None]:
        """Show a busy line with the elapsed time inside the block while nothing else is shown. Terminals only."""
        before, self._busy, self._busy_s = self._busy, text, time.monotonic()
        try:
            self._show_progress()
            yield
        finally:
            self._busy, self._busy_s = before, time.monotonic()
            if not before:
                self.hide_progress()

    def _show_progress(self) -> None:
        with self._lock:
            shows = self._terminal and sys.stderr is not None and sys.stderr.isatty()
            if not shows or Console._line is not None:
                return
            from rich.console import Console as Terminal
            from rich.live import Live

            how: Any = {"refresh_per_second": _REDRAWS, "redirect_stdout": False, "redirect_stderr": False}
            terminal = Terminal(file=_StandardError(), markup=False, highlight=False)
            Console._line = Live(console=terminal, get_renderable=self._progress, transient=True, **how)
            Console._line.start()

    def _progress(self) -> RenderableType:
        now = time.monotonic()
        if not self._busy or now - self._bar_s < 2.0 * TICK_S:
            return self._bar
        elapsed_s = now - self._busy_s
        return f"{self._busy} ... {elapsed_s:.0f} s" if elapsed_s >= TICK_S else ""

    @classmethod
    def hide_progress(cls) -> None:
        """Erase the progress line."""
        with cls._lock:
            if Console._line is not None:
                Console._line.stop()
                Console._line = None

    def table(
        self, header: Sequence[str], rows: Iterable[Sequence[object]], width: int | None = None
    ) -> None:
        """Write a table with numbers right-aligned and text left-aligned.

        Args:
            header: names of the columns.
            rows: cells of each row.
            width: largest width in columns; longer texts are wrapped. None: the terminal's, or any in a file or a pipe.
        """
        for line in table_lines(header, rows, width or (None if self._terminal else _UNBOUNDED)):
            self.say(line)

    def result(self, value: dict[str, Any]) -> None:
        """Write the JSON object if `as_json` is set."""
        self.hide_progress()
        if self.as_json and sys.stdout is not None:
            self._stream = sys.stdout
            self._write(json.dumps(value, indent=2, allow_nan=False) + "\n")

    def _write(self, text: str) -> None:
        with self._lock:
            stream = self._stream
            if stream is None:
                return
            self._bar, self._bar_s = "", time.monotonic()
            self.hide_progress()
            try:
                stream.write(text)
                stream.flush()
            except OSError as error:
                self._stream, self._terminal, self._lost = None, False, error
                _silence(stream)
                if self._needed or not isinstance(error, BrokenPipeError):
                    raise OutputLost(error) from error
            if self._busy:
                self._show_progress()


atexit.register(Console.hide_progress)


def say_on_stderr(text: str) -> None:
    """Write one line to standard error. Ignore a failed write: the exit code reports the outcome too."""
    Console.hide_progress()
    _StandardError().write(f"{_harmless(text)}\n")


class _StandardError(io.StringIO):
    """Standard error as a terminal for rich. Failed writes are ignored."""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        if sys.stderr is not None:
            try:
                sys.stderr.write(text)
                sys.stderr.flush()
            except OSError:
                _silence(sys.stderr)
        return len(text)


def _harmless(text: str) -> str:
    """Escape control characters, as names come from files of any origin, and hide credentials of URLs."""
    text = hide_credentials(text)
    return "".join(c if c.isprintable() or c in "\n\t" else ascii(c)[1:-1] for c in text)


def _silence(stream: TextIO) -> None:
    """Discard further output to a lost stream, including what it flushes when the interpreter exits."""
    with contextlib.suppress(OSError, ValueError):  # not backed by a file
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def progress_bar(text: str, fraction: float, hint: str) -> RenderableType:
    """Return a line of text, bar, percentage and hint; on a narrow terminal text and bar are shortened."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    part = min(max(fraction, 0.0), 1.0)
    line = Table.grid(padding=(0, 1), expand=True)
    line.add_column(ratio=3, no_wrap=True, overflow="ellipsis")
    line.add_column(ratio=2)
    line.add_column(no_wrap=True)
    tail = f"{100 * part:4.0f} %" + (f"  {hint}" if hint else "")
    line.add_row(Text(_harmless(text)), ProgressBar(1.0, part), Text(tail))
    return line


def table_lines(header: Sequence[str], rows: Iterable[Sequence[object]], width: int | None) -> list[str]:
    """Return the lines of a table, at most `width` columns wide; None: as wide as the terminal."""
    from rich.box import Box
    from rich.console import Console as Page
    from rich.table import Table
    from rich.text import Text

    rule = Box("    \n" * 2 + " -  \n" + "    \n" * 5, ascii=True)  # dashes below the header, no other line
    table = Table(box=rule, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    kept = list(rows)
    for i, name in enumerate(header):
        numbers = all(isinstance(row[i], int | float) or row[i] is None for row in kept)
        table.add_column(Text(name), justify="right" if numbers else "left", no_wrap=numbers, overflow="fold")
    for row in kept:
        table.add_row(*(Text(_text(value)) for value in row))
    page = Page(file=io.StringIO(), width=width, color_system=None)
    with page.capture() as drawn:
        page.print(table)
    return [line.rstrip() for line in drawn.get().splitlines()]


def _text(value: object) -> str:
    """Return the text of a table's cell; small numbers have one more decimal."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"
    return str(value)
