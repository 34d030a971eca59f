"""Ports: what a link sends and receives by. A serial one fails with one clear line, and has one user."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import select
import termios
import threading
from collections.abc import Callable
from typing import Protocol

import serial

from arm.errors import InputError
from driver.line.protocol import BAUD

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


class Port(Protocol):
    """Bytes to and from a controller. Used by the one thread that writes; bytes may be delivered by another."""

    url: str

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Hand over everything that arrives from now on, and tell once if the port is gone.

        What `deliver` raises as an OSError ends the listening, and is told by `lose`.
        """
        ...

    @property
    def out_waiting(self) -> int:
        """Bytes written that have not left this host, as far as the port can tell."""
        ...

    def write(self, data: bytes) -> object:
        """Send bytes; raises one of PORT_ERRORS."""
        ...

    def reset_output_buffer(self) -> None:
        """Drop what has not left this host; raises one of PORT_ERRORS."""
        ...

    def close(self) -> None:
        """Listen no more and let the port go. Whatever is still unsent is dropped."""
        ...


class SerialPort:
    """A device or a socket, with a thread that reads it.

    Args:
        url, write_timeout_s: see `open_port`.

    Raises:
        InputError: it cannot be opened.
    """

    def __init__(self, url: str, write_timeout_s: float) -> None:
        self.url = url
        self.serial = open_port(url, write_timeout_s)
        self._wake_reader, self._wake = os.pipe()
        self._thread: threading.Thread | None = None

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Start the thread; see `Port.listen`."""
        self._thread = threading.Thread(
            target=self._read, args=(deliver, lose), name=f"port {self.url}", daemon=True
        )
        self._thread.start()

    def _read(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        try:
            descriptor = self.serial.fileno()
            while True:
                ready, _, _ = select.select([descriptor, self._wake_reader], [], [])
                if self._wake_reader in ready:
                    return
                data = os.read(descriptor, 4096)
                if not data:
                    raise OSError("closed by the other side")
                deliver(data)
        except OSError as error:
            lose(error)

    @property
    def out_waiting(self) -> int:
        """Bytes that the system still holds; 0 where it cannot tell (sockets)."""
        try:
            return self.serial.out_waiting
        except (AttributeError, *PORT_ERRORS):
            return 0

    def write(self, data: bytes) -> None:
        """Send bytes; raises one of PORT_ERRORS."""
        self.serial.write(data)

    def reset_output_buffer(self) -> None:
        """Drop what the system still holds; raises one of PORT_ERRORS."""
        self.serial.reset_output_buffer()

    def close(self) -> None:
        """End the thread and close the port."""
        os.write(self._wake, b"x")
        if self._thread is not None:
            self._thread.join()
        os.close(self._wake)
        os.close(self._wake_reader)
        close_port(self.serial)


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
