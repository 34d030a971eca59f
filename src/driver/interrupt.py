"""Interrupts while an arm may move: SIGINT, SIGTERM, SIGHUP and SIGQUIT become one KeyboardInterrupt.

A shell that starts a program in the background makes it deaf to SIGINT, and the others (a kill, a closed terminal)
would end it without a word to the arm; neither may be while something moves. Signals come in pairs: a terminal that
closes is told by the kernel and by the shell, a service is ended by SIGTERM and then SIGHUP, and people press Ctrl-C
twice. The first is heard; the others must not cut off what it sets going.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)

_armed = False
_ends = False  # whether the program ends by the first signal
_heard = False


@contextmanager
def interruptible(ends: bool = False) -> Iterator[None]:
    """Inside, a signal of `SIGNALS` raises KeyboardInterrupt in the main thread; those that follow do nothing.

    Every wait of this project has a deadline, so what the first one sets going comes to an end by itself; then
    `hear_again` makes the next one count. In other threads, and nested, this does nothing.

    Args:
        ends: the program ends by the first signal: later ones are never heard.
    """
    global _armed, _ends, _heard
    if _armed or threading.current_thread() is not threading.main_thread():
        yield
        return
    _armed, _ends, _heard = True, ends, False
    before = {number: signal.signal(number, _raise) for number in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _armed = False


def hear_again() -> None:
    """What the last signal set going is done, the arm stands: the next one is heard, unless the program ends."""
    global _heard
    _heard = _ends and _heard


def _raise(number: int, frame: FrameType | None) -> None:
    global _heard
    if not _heard:
        _heard = True
        raise KeyboardInterrupt(signal.Signals(number).name)
