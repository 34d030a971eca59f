"""Ports that a link sends and receives by. A serial port is opened exclusively."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import select
import socket
import termios
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import serial

from arm.errors import InputError
from arm.io.claim import Claim, Holder, holder_of
from arm.io.slips.ports import port_fault
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
    """Bytes to and from a controller. Only one thread uses it; another may deliver received bytes."""

    url: str

    def listen(self, deliver: Callable[[bytes], None], lose: Callable[[OSError], None]) -> None:
        """Pass everything received from now on to `deliver`, and call `lose` once if the port is gone.

        An OSError raised by `deliver` ends the listening and is passed to `lose`.
        """
        ...

    @property
    def out_waiting(self) -> int:
        """Bytes written that have not left this host; 0 if unknown."""
        ...

    def write(self, data: bytes) -> object:
        """Send bytes; raises one of PORT_ERRORS."""
        ...

    def reset_output_buffer(self) -> None:
        """Drop what has not left this host; raises one of PORT_ERRORS."""
        ...

    def close(self) -> None:
        """Stop listening and close the port. Unsent bytes are dropped."""
        ...


class SerialPort:
    """A device or a socket, with a reader thread. While it is open, `port_holder` names this program.

    Args:
        url, write_timeout_s: see `open_port`.
        log: wire log of this program.
        brief: whether it is closed again at once (`arm.io.claim.Holder`).

    Raises:
        InputError: the port cannot be opened, or another program of this user has it open (`arm.io.claim.Claimed`).
    """

    def __init__(
        self, url: str, write_timeout_s: float, log: Path | None = None, brief: bool = False
    ) -> None:
        self.url = url
        self._claim = Claim(_claimed_as(url), log, brief=brief)
        try:
            self.serial = open_port(url, write_timeout_s)
        except BaseException:
            self._claim.release()
            raise
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
        """Bytes still in the system's buffer; 0 if unknown (sockets)."""
        try:
            return self.serial.out_waiting
        except (AttributeError, *PORT_ERRORS):
            return 0

    def write(self, data: bytes) -> None:
        """Send bytes; raises one of PORT_ERRORS."""
        self.serial.write(data)

    def reset_output_buffer(self) -> None:
        """Drop what is in the system's buffer; raises one of PORT_ERRORS."""
        self.serial.reset_output_buffer()

    def close(self) -> None:
        """End the thread and close the port, in any state. Unsent bytes are dropped: a unit that is off takes none."""
        os.write(self._wake, b"x")
        if self._thread is not None:
            self._thread.join()
        os.close(self._wake)
        os.close(self._wake_reader)
        connection = getattr(self.serial, "_socket", None)
        for close in (self.serial.reset_output_buffer, self.serial.close):
            with contextlib.suppress(*PORT_ERRORS):
                close()
        if connection is not None:
            connection.close()  # pyserial does not, if the other side closed first
        self._claim.release()


def port_holder(url: str) -> Holder | None:
    """Return the program of this user that has a port open by `SerialPort`; None if there is none."""
    return holder_of(_claimed_as(url))


def _claimed_as(url: str) -> str:
    """Return the name under which a port is claimed: links to a device are the device, names of a host its address."""
    found = re.fullmatch(r"socket://(?P<host>[^/:]+):(?P<port>\d+).*", url)
    if found is None:
        return f"port {os.path.realpath(url)}"
    try:
        addresses = {str(of[4][0]) for of in socket.getaddrinfo(found["host"], None, type=socket.SOCK_STREAM)}
    except (OSError, UnicodeError):  # opening it tells
        addresses = {found["host"]}
    return f"port socket://{min(addresses)}:{int(found['port'])}"


def open_port(url: str, write_timeout_s: float) -> serial.Serial:
    """Open a port exclusively with the unit's line settings: 19200 8N1, RTS/CTS.

    A lock on the file keeps out other programs that use this function; TIOCEXCL keeps all others out of a real tty.
    A pseudo-terminal has the lock only: after a killed program, TIOCEXCL would stay set as long as its other side is
    open.

    Args:
        url: a device path, or ``socket://host:port``.
        write_timeout_s: wall seconds after which a write fails.

    Raises:
        InputError: the port does not exist, is not a serial line, is in use, or is not permitted.
    """
    if fault := port_fault(url):
        raise InputError(f"port {url}: {fault}", port=url)
    try:
        port = serial.serial_for_url(
            url, baudrate=BAUD, rtscts=True, timeout=0, write_timeout=write_timeout_s, exclusive=True
        )
    except (ValueError, *PORT_ERRORS) as error:
        raise InputError(f"port {url}: {missing_port(url) or _why(error)}", port=url) from error
    try:
        descriptor = port.fileno()
    except (AttributeError, OSError) as error:
        port.close()
        why = f"port {url}: has no file descriptor; use a device or socket://host:port"
        raise InputError(why, port=url) from error
    if url.startswith("/") and not os.path.realpath(url).startswith("/dev/pts/"):
        with contextlib.suppress(OSError):
            fcntl.ioctl(descriptor, termios.TIOCEXCL)
    return port


def require_there(url: str) -> None:
    """Refuse a device that is not there, before a person is asked anything.

    Raises:
        InputError: the name is no port's, or there is no such device.
    """
    gone = _WHY[errno.ENOENT] if "://" not in url and not os.path.exists(url) else ""
    if fault := port_fault(url) or missing_port(url) or gone:
        raise InputError(f"port {url}: {fault}", port=url)


def missing_port(url: str) -> str:
    """Say what is known of a device that is not there: a link whose target is gone, a name of something else, or a
    device of nearly this name; "" of any other, and of what is there."""
    if "://" in url:
        return ""
    try:
        os.stat(url)
        return ""
    except FileNotFoundError:
        pass
    except (OSError, ValueError):  # opening it tells
        return ""
    if os.path.islink(url):
        target = os.path.realpath(url)
        return f"is a link to {target}, which is gone: the emulator or device behind it has ended; start it again"
    name = os.path.basename(url)
    if found := re.fullmatch(r"(?:\\\\\.\\)?(COM\d{1,3}):?", name, re.IGNORECASE):
        return f"is not there: {found[1]} is a port's name on Windows; here a device is such as /dev/ttyUSB0"
    if url.startswith(("~", "$")):
        return "is not there: the shell did not replace its beginning, perhaps because of quotes"
    if re.fullmatch(r"(?i)crs\d+", url):
        return "is not there: it is a unit's name, and its port belongs here: a device, or socket://HOST:PORT"
    if url == str(BAUD):
        return "is not there: it is the line's speed, which is fixed; give the device alone"
    if url.isdecimal():
        return f"is not there: with a number alone the host is missing: socket://127.0.0.1:{url}, or a device"
    if re.fullmatch(r"video\d+", name):
        return "is not there: video is a camera's name, and the controller's port belongs here"
    if like := _alike(url):
        return f"is not there; is {like} meant, which is?"
    if re.fullmatch(r"(tty|pts/)\w*\d", url):
        return f"is not there: the names of devices begin with /dev/: is /dev/{url} meant?"
    return ""


def _alike(url: str) -> str:
    """Return a device that is there and has nearly this name: in other letters, with another number at its end, or in
    /dev; "" if there is none."""

    def stem(name: str) -> str:
        return name.lower().rstrip("0123456789")

    folder, name = os.path.split(url)
    with contextlib.suppress(OSError):
        for other in sorted(os.listdir(folder or ".")):
            if stem(other) == stem(name) and Path(folder, other).is_char_device():
                return os.path.join(folder, other)
    absent = os.path.join("/dev", name)
    return absent if Path(absent).is_char_device() else ""


def _why(error: BaseException) -> str:
    number = getattr(error, "errno", None)
    if number is None and "Inappropriate ioctl" in str(error):  # pyserial drops the number
        number = errno.ENOTTY
    words = str(error).rpartition("] ")[2]  # pyserial repeats the name, and the error's number
    return _WHY.get(number or 0, f"cannot be opened: {words}; is a unit or a465 emulate --tcp there?")
