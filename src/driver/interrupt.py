"""Interrupts while an arm may move: SIGINT, SIGTERM, SIGHUP and SIGQUIT become one KeyboardInterrupt.

A shell that starts a program in the background makes it deaf to SIGINT, and the others (a kill, a closed terminal)
would end it without a word to the arm; neither may be while something moves. Signals come in pairs: a terminal that
closes is told by the kernel and by the shell, a service is ended by SIGTERM and then SIGHUP, and people press Ctrl-C
twice. The first is heard; those that follow at once must not cut off what it sets going.
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
_ends = False  # whether the program ends by a signal
_heard_at = -QUIET_S


@contextmanager
def interruptible(ends: bool = False) -> Iterator[None]:
    """Inside, a signal of `SIGNALS` raises KeyboardInterrupt in the main thread; others do nothing for `QUIET_S`.

    In other threads, and nested, this does nothing.

    Args:
        ends: the program ends by a signal, so `hear_again` is of no use: what is told at the end is to be told.
    """
    global _armed, _ends, _heard_at
    if _armed or threading.current_thread() is not threading.main_thread():
        yield
        return
    _armed, _ends, _heard_at = True, ends, time.monotonic() - QUIET_S
    before = {number: signal.signal(number, _raise) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _armed = False


def hear_again() -> None:
    """What the last signal set going is done, the arm stands: the next one is heard at once."""
    global _heard_at
    if not _ends:
        _heard_at = time.monotonic() - QUIET_S


def _raise(number: int, frame: FrameType | None) -> None:
    global _heard_at
    now = time.monotonic()
    if now - _heard_at >= QUIET_S:
        _heard_at = now
        raise KeyboardInterrupt(signal.Signals(number).name)
