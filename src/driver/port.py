"""Opening a serial port so that every way it can fail is one clear line, and nobody else can write to it."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import termios

import serial

from arm.errors import InputError
from driver.protocol import BAUD

PORT_ERRORS = (OSError, termios.error)  # what using a port can raise; pyserial's own errors are OSErrors

_WHY = {
    errno.ENOENT: "is not there; is the cable plugged in and the name right?",
    errno.ENXIO: "is not there; is the cable plugged in?",
    errno.EACCES: "may not be opened by this user; join the group that owns it (often dialout)",
    errno.EPERM: "may not be opened by this user; join the group that owns it (often dialout)",
    errno.EBUSY: "is in use by another program; end that first",
    errno.EAGAIN: "is in use by another program; end that first",
    errno.EISDIR: "is a folder, not a serial line",
    errno.ENOTTY: "is not a serial line",
}


def open_port(url: str, write_timeout_s: float) -> serial.Serial:
    """An exclusive port with the unit's line settings: 19200 8N1, RTS/CTS.

    Two programs that both use this refuse each other by a lock on the file; a program that does not ask is kept
    out of a real tty by TIOCEXCL. (A pseudo-terminal whose other side keeps it open would stay closed for ever
    after a killed program, so it has the lock only.)

    Args:
        url: a device path, or a URL that pyserial knows and that has a file behind it (``socket://host:port``).
        write_timeout_s: wall seconds after which a write fails.

    Raises:
        InputError: not there, no serial line, in use, or not permitted.
    """
    if url.startswith("socket://") and not re.fullmatch(r"socket://[^/:]+:\d{1,5}/?(\?.*)?", url):
        raise InputError(f"port {url}: must be socket://HOST:PORT, such as socket://127.0.0.1:4650", port=url)
    if "://" in url and not url.startswith("socket://"):
        raise InputError(f"port {url}: must be a device, or socket://HOST:PORT", port=url)
    try:
        port = serial.serial_for_url(
            url, baudrate=BAUD, rtscts=True, timeout=0, write_timeout=write_timeout_s, exclusive=True
        )
    except (ValueError, *PORT_ERRORS) as error:
        raise InputError(f"port {url}: {_why(error)}", port=url) from error
    try:
        descriptor = port.fileno()
    except (AttributeError, OSError) as error:
        port.close()
        raise InputError(
            f"port {url}: has no file behind it; use a device or socket://host:port", port=url
        ) from error
    if url.startswith("/") and not os.path.realpath(url).startswith("/dev/pts/"):
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
    return port


def close_port(port: serial.Serial) -> None:
    """Close a port, whatever state it is in. Unsent bytes are dropped: a unit that is off would hold the close."""
    connection = getattr(port, "_socket", None)
    with contextlib.suppress(*PORT_ERRORS):
        port.reset_output_buffer()
    with contextlib.suppress(*PORT_ERRORS):
        port.close()
    if connection is not None:
        connection.close()  # pyserial forgets to, when the other side has gone first


def _why(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    if number is None and "Inappropriate ioctl" in str(error):  # pyserial keeps the number in the text
        number = errno.ENOTTY
    if number in _WHY:
        return _WHY[number]
    return f"cannot be opened: {error}"
