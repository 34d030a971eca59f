"""The ports of an emulated unit: pseudo-terminals with their links, TCP listeners and connections, memory lines."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from driver.emulator.line.memory import MemoryLine, MemoryWire
from driver.emulator.line.uart import Wire


@dataclass
class _Terminal:
    wire: Wire
    slave: int  # open for ever: else reading ends when a client leaves
    link: Path | None


class Ports:
    """Opens, closes, loses and restores ports. Not thread-safe: the emulator's lock guards it.

    Args:
        paced: see `Wire`.
        equip: called with every new wire.

    Attributes:
        wires: one a pseudo-terminal and one a connected client.
        listeners: of TCP.
    """

    def __init__(self, paced: bool, equip: Callable[[Wire], None]) -> None:
        self._paced = paced
        self._equip = equip
        self.wires: list[Wire] = []
        self.listeners: list[socket.socket] = []
        self._sockets: dict[int, socket.socket] = {}
        self._terminals: list[_Terminal] = []
        self._lines: list[MemoryLine] = []
        self._lost_links: list[Path | None] = []
        self._lost_ports: list[int] = []

    def open_pty(self, link: Path | None) -> str:
        """A raw pseudo-terminal; its path. `link` becomes a symbolic link to it.

        Raises:
            InputError: `link` cannot be made.
        """
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        path = os.ttyname(slave)
        if link is not None:
            try:
                link.symlink_to(path)
            except OSError as error:
                os.close(master)
                os.close(slave)
                raise InputError(f"{link}: cannot be made a link to {path}: {error.strerror}") from error
        wire = Wire(master, self._paced)
        self._terminals.append(_Terminal(wire, slave, link))
        self._add(wire)
        return path

    def open_tcp(self, port: int) -> str:
        """A listener on the loopback, 0 any free port; its URL."""
        listener = socket.create_server(("127.0.0.1", port))
        listener.setblocking(False)
        self.listeners.append(listener)
        return f"socket://127.0.0.1:{listener.getsockname()[1]}"

    def open_line(self, line: MemoryLine) -> None:
        """Listen at the unit's end of a line in memory. Once lost, it stays lost."""
        self._lines.append(line)
        self._add(MemoryWire(line, self._paced))

    def _add(self, wire: Wire) -> None:
        self._equip(wire)
        self.wires.append(wire)

    def paths(self) -> tuple[str, ...]:
        """Of the pseudo-terminals that are there now."""
        return tuple(os.ttyname(t.slave) for t in self._terminals)

    def accept(self) -> None:
        """Take waiting clients, one at a time: a serial line has one other end, so a second one is turned away."""
        for listener in self.listeners:
            with contextlib.suppress(BlockingIOError):
                connection, _ = listener.accept()
                if not all(map(_has_left, self._sockets.values())):
                    connection.close()
                    continue
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets[connection.fileno()] = connection
                self._add(Wire(connection.fileno(), self._paced))

    def drop(self, wire: Wire) -> None:
        """A client's connection that is over."""
        self.wires.remove(wire)
        self._sockets.pop(wire.descriptor).close()

    def lose(self) -> None:
        """Everything goes: connections, listeners, pseudo-terminals and links."""
        self._lost_ports += [listener.getsockname()[1] for listener in self.listeners]
        self._lost_links += [terminal.link for terminal in self._terminals]
        self.close()

    def restore(self) -> None:
        """What was lost is there again: a listener on the same port, a new pseudo-terminal behind the same link.

        Raises:
            OSError: the TCP port has been taken by another program.
            InputError: the link has been made by another program.
        """
        for port in self._lost_ports:
            self.open_tcp(port)
        for link in self._lost_links:
            self.open_pty(link)
        self._lost_ports, self._lost_links = [], []

    def close(self) -> None:
        """Close everything and remove the links; listeners first, so that no client that was lost comes in again."""
        for connection in (*self.listeners, *self._sockets.values()):
            connection.close()
        for line in self._lines:
            line.hang_up()
        for terminal in self._terminals:
            if terminal.link is not None:
                terminal.link.unlink(missing_ok=True)
            os.close(terminal.wire.descriptor)
            os.close(terminal.slave)
        self._sockets.clear()
        self._lines.clear()
        self.wires.clear()
        self.listeners.clear()
        self._terminals.clear()


def _has_left(connection: socket.socket) -> bool:
    """Whether a client has closed its end, which reading may not have come to yet."""
    try:
        return not connection.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True
