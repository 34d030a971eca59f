"""Interrupts while an arm may move: SIGINT, SIGTERM, SIGHUP and SIGQUIT become one KeyboardInterrupt.

A shell that starts a program in the background makes it deaf to SIGINT, and the others (a kill, a closed terminal)
would end it without a word to the arm; neither may be while something moves. Signals come in pairs: a terminal that
closes is told by the kernel and by the shell, a service is ended by SIGTERM and then SIGHUP, and people press Ctrl-C
twice. The first is heard; those that follow at once must not cut off what it sets going. Once a program that ends by it
has caught it (`caught`), no other is heard until the end: a burst of signals ends as one signal does.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

# Wall time after a signal in which others do nothing. Not for ever: Python drops an interrupt that is raised where
# nobody can catch it (a finaliser, a callback), and Ctrl-C must work again then.
QUIET_S = 1.0

_armed = False
_held = False
_waits: KeyboardInterrupt | None = None  # while held
_ends = False  # whether the program ends by a signal
# Wall time after `caught` in which signals do nothing: stopping the arm and writing the report take less. Not for ever:
# if they should hang, Ctrl-C must work again.
ENDING_S = 60.0

_heard_at = -QUIET_S
_deaf_until = 0.0
_signalled = False


@contextmanager
def interruptible(ends: bool = False) -> Iterator[None]:
    """Inside, a signal of `SIGNALS` raises KeyboardInterrupt in the main thread; others do nothing for `QUIET_S`.

    In other threads, and nested, this does nothing.

    Args:
        ends: the program ends by a signal, so `hear_again` is of no use: what is told at the end is to be told. After
            `caught`, signals are ignored also behind the block, where the program has nothing left to do but to leave.
    """
    global _armed, _ends, _heard_at, _signalled, _deaf_until
    if _armed or threading.current_thread() is not threading.main_thread():
        yield
        return
    _armed, _ends, _heard_at = True, ends, time.monotonic() - QUIET_S
    _signalled, _deaf_until = False, 0.0
    before = {number: signal.signal(number, _raise) for number in SIGNALS}
    try:
        yield
    finally:
        over = time.monotonic() < _deaf_until
        for number, handler in before.items():
            # what is left to do is to leave: an exit code that says what was done is not to be lost for one more signal
            signal.signal(number, signal.SIG_IGN if over else handler)
        _armed = False


@contextmanager
def held() -> Iterator[None]:
    """Inside, an `interruptible` signal waits for the end: what is begun is not left half done. For short work only."""
    global _held, _waits
    if _held:
        yield
        return
    _held = True
    try:
        yield
    finally:
        _held = False
        told, _waits = _waits, None
        if told is not None:
            raise told


def hear_again() -> None:
    """What the last signal set going is done, the arm stands: the next one is heard at once."""
    global _heard_at
    if not _ends:
        _heard_at = time.monotonic() - QUIET_S


def caught() -> None:
    """The last signal is being dealt with, and the program ends by it, if it is one that does: no other is heard."""
    global _deaf_until
    if _ends and _signalled:
        _deaf_until = time.monotonic() + ENDING_S


def _raise(number: int, frame: FrameType | None) -> None:
    global _heard_at, _signalled, _waits
    now = time.monotonic()
    if now - _heard_at >= QUIET_S and now >= _deaf_until:
        _heard_at, _signalled = now, True
        told = KeyboardInterrupt(signal.Signals(number).name)
        if not _held:
            raise told
        _waits = told
