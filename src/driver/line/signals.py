"""Interrupts while an arm may move: SIGINT, SIGTERM, SIGHUP, SIGQUIT and SIGTSTP become one KeyboardInterrupt.

By default a program in the background ignores SIGINT, and the other signals (a kill, a closed terminal) end it without
stopping the arm; Ctrl-Z (SIGTSTP) halts it, and the arm goes on without it. None of this may happen while the arm
moves. Signals also come in pairs: kernel and shell both send SIGHUP when a terminal closes, a service gets SIGTERM and
then SIGHUP, and people press Ctrl-C twice. The first signal counts; others shortly after it are ignored, so that they
do not interrupt the stop. Once a program that ends by a signal has caught it (`caught`), all others are ignored until
it exits.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
_INTERRUPTS = (*SIGNALS, signal.SIGTSTP)

# Wall time after a signal in which others are ignored. Limited because Python drops an interrupt raised where it cannot
# be caught (a finaliser, a callback); Ctrl-C must then work again.
QUIET_S = 1.0
# Wall time after `caught` in which signals are ignored: stopping the arm and writing the report take less. Limited so
# that Ctrl-C works again if they hang.
ENDING_S = 60.0

_armed = False
_held = False
_waits: KeyboardInterrupt | None = None  # while held
_ends = False  # whether the program ends by a signal
_heard_at = -QUIET_S
_deaf_until = 0.0
_signalled = False


@contextmanager
def interruptible(ends: bool = False) -> Iterator[None]:
    """Inside, a signal raises KeyboardInterrupt in the main thread; others are ignored for `QUIET_S`.

    Does nothing in other threads, or when nested.

    Args:
        ends: the program ends by a signal. Then `hear_again` does nothing, and after `caught` signals are ignored even
            when the block has been left, so that the final output is complete.
    """
    global _armed, _ends, _heard_at, _signalled, _deaf_until
    if _armed or threading.current_thread() is not threading.main_thread():
        yield
        return
    _armed, _ends, _heard_at = True, ends, time.monotonic() - QUIET_S
    _signalled, _deaf_until = False, 0.0
    before = {number: signal.signal(number, _raise) for number in _INTERRUPTS}
    try:
        yield
    finally:
        over = time.monotonic() < _deaf_until
        for number, handler in before.items():
            # the program only has to exit: a further signal must not replace its exit code
            signal.signal(number, signal.SIG_IGN if over else handler)
        _armed = False


def leave_to_others() -> None:
    """From now on `interruptible` does nothing in this process: another one hears the signals, and ends this one."""
    global _armed
    _armed = True


@contextmanager
def held() -> Iterator[None]:
    """Inside, an `interruptible` signal is deferred to the end of the block. For short work only."""
    global _held, _waits
    if _held:
        yield
        return
    _held = True
    try:
        yield
    finally:
        _held = False
        interrupt, _waits = _waits, None
        if interrupt is not None:
            raise interrupt


def hear_again() -> None:
    """Stop ignoring signals: the last one has been handled and the arm is at rest."""
    global _heard_at
    if not _ends:
        _heard_at = time.monotonic() - QUIET_S


def caught() -> None:
    """Ignore further signals while the last one ends the program (see `interruptible`)."""
    global _deaf_until
    if _ends and _signalled:
        _deaf_until = time.monotonic() + ENDING_S


def _raise(number: int, frame: FrameType | None) -> None:
    global _heard_at, _signalled, _waits
    now = time.monotonic()
    if now - _heard_at >= QUIET_S and now >= _deaf_until:
        _heard_at, _signalled = now, True
        interrupt = KeyboardInterrupt(signal.Signals(number).name)
        if not _held:
            raise interrupt
        _waits = interrupt
