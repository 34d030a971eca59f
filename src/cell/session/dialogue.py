"""Ask a person at the terminal before a real arm moves. Only a whole line typed after the question counts."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
from collections.abc import Callable
from typing import TypeVar

from arm.errors import InputError
from cell.console import Console

T = TypeVar("T")
TRIES = 3
LONGEST = 20_000  # bytes of a line; terminals deliver no more
WAIT_S = 600.0  # time for a person to type


def asked(
    console: Console,
    question: str,
    wanted: str,
    is_right: Callable[[str], bool],
    answer: Callable[[], str | None],
) -> bool:
    """Ask up to `TRIES` times; return whether the right line was typed.

    Args:
        console: for output.
        question: printed before each try.
        wanted: description of the right line.
        is_right: whether a line is right.
        answer: returns a typed line, or None if nobody can type.
    """
    for left in reversed(range(TRIES)):
        _forget_typed()
        console.say(question)
        typed = answer()
        if typed is None:
            return False
        if is_right(typed):
            return True
        if left:
            console.say(f"that is not {wanted}; {left} more {'try' if left == 1 else 'tries'}")
    return False


def answered(
    console: Console,
    question: str,
    read: Callable[[str], T],
    answer: Callable[[], str | None],
    otherwise: str,
) -> T | None:
    """Return what is read from the first right answer of up to `TRIES`; None for an empty line.

    Args:
        console, question, answer: see `asked`.
        read: reads a line without spaces around it; raises an InputError for a wrong one.
        otherwise: what to do if nobody answers, the end of the message.

    Raises:
        InputError: nobody answers, or the last answer is wrong.
    """
    for left in reversed(range(TRIES)):
        _forget_typed()
        console.say(question)
        line = answer()
        if line is None:
            raise InputError(f"nobody answered: {question.rstrip(': ')}; {otherwise}")
        if not line.strip():
            return None
        try:
            return read(line.strip())
        except InputError as error:
            if not left:
                raise
            console.say(f"{error}; {left} more {'try' if left == 1 else 'tries'}")
    return None


def _forget_typed() -> None:
    """Drop what was typed before a question."""
    with contextlib.suppress(OSError, ValueError, termios.error):
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def require_word(
    console: Console, question: str, word: str, answer: Callable[[], str | None], otherwise: str, option: str
) -> None:
    """Ask for a word, in upper or lower case.

    Args:
        console, question, answer: see `asked`.
        word: to be typed.
        otherwise: consequence if it is not typed, the end of the message.
        option: of the command line; it answers the question in advance.

    Raises:
        InputError: the word was not typed.
    """
    if not asked(console, question, word, lambda line: line.lower() == word.lower(), answer):
        raise InputError(f"{word!r} was not typed; {otherwise}", option=option)


def at_terminal() -> bool:
    """Whether a person can answer: there is a terminal, with the program in its foreground."""
    return foreground_terminal() is not None


def foreground_terminal() -> int | None:
    """Descriptor of standard input if it is a terminal with this program in its foreground.

    The system stops a background program that changes its terminal, which would leave the arm unmonitored.
    """
    try:
        descriptor = sys.stdin.fileno()
        foreground = os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp()
    except (AttributeError, ValueError, OSError):  # standard input is missing, closed, or not our terminal
        return None
    return descriptor if foreground else None


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
