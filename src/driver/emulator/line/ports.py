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
from driver.emulator.options import EmulatorOptions


@dataclass
class _Terminal:
    wire: Wire
    slave: int  # kept open, as otherwise reading ends when a client leaves
    link: Path | None


class Ports:
    """Opens, closes, loses and restores ports. Not thread-safe: the emulator's lock guards it.

    Args:
        options, echoing: see `Wire`.

    Attributes:
        wires: one per pseudo-terminal, TCP client and line in memory.
        listeners: TCP listeners.
    """

    def __init__(self, options: EmulatorOptions, echoing: Callable[[], bool]) -> None:
        self._options, self._echoing = options, echoing
        self.wires: list[Wire] = []
        self.listeners: list[socket.socket] = []
        self._sockets: dict[int, socket.socket] = {}
        self._terminals: list[_Terminal] = []
        self._lines: list[MemoryLine] = []
        self._lost_links: list[Path | None] = []
        self._lost_ports: list[int] = []

    def open_pty(self, link: Path | None) -> str:
        """Open a raw pseudo-terminal and return its path. `link` becomes a symbolic link to it.

        Raises:
            InputError: `link` cannot be created.
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
                raise InputError(f"{link}: cannot link to {path}: {error.strerror}") from error
        wire = self._serve(master)
        self._terminals.append(_Terminal(wire, slave, link))
        return path

    def _serve(self, descriptor: int) -> Wire:
        wire = Wire(descriptor, self._options, self._echoing)
        self.wires.append(wire)
        return wire

    def open_tcp(self, port: int) -> str:
        """Listen on a loopback port (0: any free one) and return its URL."""
        listener = socket.create_server(("127.0.0.1", port))
        listener.setblocking(False)
        self.listeners.append(listener)
        return f"socket://127.0.0.1:{listener.getsockname()[1]}"

    def open_line(self, line: MemoryLine) -> None:
        """Serve the unit's end of a line in memory. It cannot be restored once lost."""
        self._lines.append(line)
        self.wires.append(MemoryWire(line, self._options, self._echoing))

    def paths(self) -> tuple[str, ...]:
        """Return the paths of the open pseudo-terminals."""
        return tuple(os.ttyname(t.slave) for t in self._terminals)

    def accept(self) -> None:
        """Accept a waiting client. Only one may be connected, as to a serial line; others are disconnected."""
        for listener in self.listeners:
            with contextlib.suppress(BlockingIOError):
                connection, _ = listener.accept()
                if not all(map(_has_left, self._sockets.values())):
                    connection.close()
                    continue
                connection.setblocking(False)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._sockets[connection.fileno()] = connection
                self._serve(connection.fileno())

    def drop(self, wire: Wire) -> None:
        """Close the connection of a client that has left."""
        self.wires.remove(wire)
        self._sockets.pop(wire.descriptor).close()

    def lose(self) -> None:
        """Close connections, listeners, pseudo-terminals and links, to restore them later."""
        self._lost_ports += [listener.getsockname()[1] for listener in self.listeners]
        self._lost_links += [terminal.link for terminal in self._terminals]
        self.close()

    def restore(self) -> None:
        """Restore what was lost: a listener on the same port, a new pseudo-terminal behind the same link.

        Raises:
            OSError: another program has taken the TCP port.
            InputError: another program has created the link.
        """
        for port in self._lost_ports:
            self.open_tcp(port)
        for link in self._lost_links:
            self.open_pty(link)
        self._lost_ports, self._lost_links = [], []

    def close(self) -> None:
        """Close everything and remove the links. Listeners first, so that no lost client connects again."""
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
    """Whether a client has closed its end, even if not all of its bytes are read."""
    try:
        return not connection.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True
