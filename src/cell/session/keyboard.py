"""Keys while an execution runs: pause, slower, faster, abort.

Only where standard input is a terminal and the program stands in its foreground. The terminal is put back as it was,
however the execution ends.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from driver.execution.control import Control

STEP = 0.1
HELP = "keys: space pause, go on; + - speed of the next motion, or in a pause; q abort"


def on_key(key: str, control: Control, abort: Callable[[], None]) -> None:
    """What one key does; any other than those of `HELP` does nothing."""
    match key:
        case " " | "p" | "P":
            if control.paused:
                control.go_on()
            else:
                control.pause()
        case "+" | "=":
            control.override = min(round(control.override + STEP, 6), control.ceiling)
        case "-" | "_":
            control.override = max(round(control.override - STEP, 6), control.least)
        case "q" | "Q":
            abort()


def hint(control: Control, running: float | None = None) -> str:
    """The end of the status line: how fast, and what can be pressed.

    Args:
        running: override that the motion of now was sent with, where one runs; another one asked for comes next.
    """
    asked = f"{100 * control.override:.0f} %"
    if control.paused:
        return f"{'PAUSED' if control.standing else 'pausing'}, then {asked}  space + - q"
    if running is not None and abs(running - control.override) > 1e-6:
        return f"{100 * running:.0f} %, next {asked}  space + - q"
    return f"{asked}  space + - q"


def interrupt_main() -> None:
    """As Ctrl-C: the main thread is interrupted, whatever it does."""
    main = threading.main_thread().ident
    if main is not None:
        signal.pthread_kill(main, signal.SIGINT)


@contextmanager
def keyboard(control: Control, abort: Callable[[], None] = interrupt_main) -> Iterator[bool]:
    """Inside, keys act on `control`; gives whether there is a keyboard at all.

    Args:
        control: of the execution.
        abort: called on q, from another thread. Ctrl-C stays the signal that it is.
    """
    descriptor = _foreground_terminal()
    if descriptor is None:
        yield False
        return
    before = termios.tcgetattr(descriptor)
    wake_reader, wake = os.pipe()
    reader = threading.Thread(
        target=_read, args=(descriptor, wake_reader, control, abort), name="keyboard", daemon=True
    )
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        reader.start()
        yield True
    finally:
        with contextlib.suppress(termios.error):  # the terminal may be gone: that is why we end
            termios.tcsetattr(descriptor, termios.TCSANOW, before)
        os.write(wake, b"x")
        if reader.ident is not None:
            reader.join()
        os.close(wake)
        os.close(wake_reader)


def _foreground_terminal() -> int | None:
    """Descriptor of standard input if it is a terminal that listens to this program.

    A program in the background that changes its terminal is stopped by the system, and the arm would be left alone.
    """
    try:
        descriptor = sys.stdin.fileno()
        foreground = os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp()
    except (AttributeError, ValueError, OSError):  # no standard input, a closed one, or no terminal of ours
        return None
    return descriptor if foreground else None


def _read(descriptor: int, wake: int, control: Control, abort: Callable[[], None]) -> None:
    while True:
        ready, _, _ = select.select([descriptor, wake], [], [])
        if wake in ready:
            return
        try:
            data = os.read(descriptor, 64)
        except OSError:
            return  # the terminal is gone; its hang-up is a signal of its own
        if not data:
            return
        if data.startswith(b"\x1b"):
            continue  # an arrow or function key comes as several characters
        for character in data.decode("latin-1"):
            on_key(character, control, abort)
