"""Keys during execution: pause, slower, faster, abort.

They work only if standard input is a terminal with the program in its foreground. The terminal's settings are restored
however the execution ends.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from cell.session.dialogue import foreground_terminal
from driver.execution.control import Control

STEP = 0.1
HELP = "keys: space pause, continue; + - speed of the next motion, or in a pause; q abort"
ABORT_HELP = "keys: space, Esc, q abort"


def on_key(key: str, control: Control, abort: Callable[[], None]) -> None:
    """Act on a key of `HELP`; ignore others."""
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
    """The end of the status line: speed and keys.

    Args:
        running: override of the present motion, if any; if that of `control` differs, it is for the next motion.
    """
    requested = f"{100 * control.override:.0f} %"
    if control.paused:
        return f"{'PAUSED' if control.standing else 'pausing'}, then {requested}  space + - q"
    if running is not None and abs(running - control.override) > 1e-6:
        return f"{100 * running:.0f} %, next {requested}  space + - q"
    return f"{requested}  space + - q"


def interrupt_main() -> None:
    """Interrupt the main thread, like Ctrl-C."""
    main = threading.main_thread().ident
    if main is not None:
        signal.pthread_kill(main, signal.SIGINT)


@contextmanager
def aborting_keys() -> Iterator[bool]:
    """Let keys abort what can neither pause nor go slower: homing, jaws. Yield whether there is a keyboard."""

    def deliver(data: bytes) -> None:
        if data == b"\x1b" or (not data.startswith(b"\x1b") and set(data) & set(b" qQ\x1b")):
            interrupt_main()

    with reading_keys(deliver) as keys:
        yield keys


@contextmanager
def keyboard(control: Control) -> Iterator[bool]:
    """Let keys act on the control of an execution; yield whether there is a keyboard. Ctrl-C remains a signal."""

    def deliver(data: bytes) -> None:
        if not data.startswith(b"\x1b"):  # arrow and function keys are several characters
            for character in data.decode("latin-1"):
                on_key(character, control, interrupt_main)

    with reading_keys(deliver) as keys:
        yield keys


@contextmanager
def reading_keys(deliver: Callable[[bytes], None], fresh: bool = False) -> Iterator[bool]:
    """Pass what the terminal delivers, key by key and without echo, to a function; yield whether there is a terminal.

    Args:
        fresh: forget what was typed before.
        deliver: called in a thread of its own, at the end of the terminal with no bytes.
    """
    descriptor = foreground_terminal()
    if descriptor is None:
        yield False
        return
    before = termios.tcgetattr(descriptor)
    wake_reader, wake = os.pipe()
    reader = threading.Thread(
        target=_read, args=(descriptor, wake_reader, deliver), name="keyboard", daemon=True
    )
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        if fresh:
            termios.tcflush(descriptor, termios.TCIFLUSH)
        reader.start()
        yield True
    finally:
        with contextlib.suppress(termios.error):  # the terminal may be gone
            termios.tcsetattr(descriptor, termios.TCSANOW, before)
        os.write(wake, b"x")
        if reader.ident is not None:
            reader.join()
        os.close(wake)
        os.close(wake_reader)


def _read(descriptor: int, wake: int, deliver: Callable[[bytes], None]) -> None:
    data = b"..."
    while data:
        ready, _, _ = select.select([descriptor, wake], [], [])
        if wake in ready:
            return
        try:
            data = os.read(descriptor, 64)
        except OSError:
            data = b""  # the terminal is gone; SIGHUP is handled elsewhere
        deliver(data)
