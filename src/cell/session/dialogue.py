"""Ask a person at the terminal before a real arm moves; only a whole line typed after the question counts."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
from collections.abc import Callable

from arm.errors import InputError
from cell.console import Console

TRIES = 3
LONGEST = 20_000  # bytes of a line; terminals deliver no more
WAIT_S = 600.0  # for a person to type


def asked(
    console: Console,
    question: str,
    wanted: str,
    is_right: Callable[[str], bool],
    answer: Callable[[], str | None],
) -> bool:
    """Whether the right line was typed in one of `TRIES` tries; `wanted` describes it."""
    for left in reversed(range(TRIES)):
        _discard_earlier_input()
        console.say(question)
        typed = answer()
        if typed is None:
            return False
        if is_right(typed):
            return True
        if left:
            console.say(f"that is not {wanted}; {left} more {'try' if left == 1 else 'tries'}")
    return False


def require_word(
    console: Console, question: str, word: str, answer: Callable[[], str | None], otherwise: str, option: str
) -> None:
    """Ask for a word, in capitals or not.

    Raises:
        InputError: it was not typed; the message ends with `otherwise`, and `option` makes the question unnecessary.
    """
    if not asked(console, question, word, same_word(word), answer):
        raise InputError(f"{word!r} was not typed; {otherwise}", option=option)


def same_word(word: str) -> Callable[[str], bool]:
    """Return whether a line is the word, in capitals or not."""
    return lambda line: line.lower() == word.lower()


def at_terminal() -> bool:
    """Whether a person can answer: there is a terminal, with the program in its foreground."""
    if sys.stdin is None or not sys.stdin.isatty():
        return False
    with contextlib.suppress(OSError):
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    return False


def _discard_earlier_input() -> None:
    """Discard what was typed before the question."""
    with contextlib.suppress(OSError, ValueError, termios.error):
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def typed() -> str | None:
    """Read a whole line from the terminal; None if none arrives in time, or the terminal is gone."""
    line, over = b"", time.monotonic() + WAIT_S
    try:
        while not line.endswith(b"\n"):
            ready, _, _ = select.select([sys.stdin], [], [], max(over - time.monotonic(), 0.0))
            more = os.read(sys.stdin.fileno(), 4096) if ready else b""
            if not more or len(line) > LONGEST:
                return None
            line += more
    except OSError:
        return None
    return line.decode(errors="replace").strip()
