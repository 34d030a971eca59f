"""The controller's port: of the command line, else of the environment, else of the cell file.

No port is ever chosen for a command that would otherwise use the simulated cell: such a command needs ``--port``.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from arm.io.node import Node
from arm.io.rules import path, port
from arm.io.slips.ports import port_fault
from arm.io.storage import leaves
from cell.config.camera_keys import OF_CELL
from cell.console import Console
from cell.files.task import task_or_cell
from driver.line.port import missing_port

VARIABLE = "A465_PORT"
KEY = "port"
EXAMPLE = 'port = "/dev/mars"'


@dataclass(frozen=True)
class PortAndPlace:
    """What a command that takes ``[PORT] [CELL]`` was given; each may be missing.

    Attributes:
        port: see `choose_port`.
        place: cell, task or program file.
    """

    port: str | None
    place: Path | None


def port_and_place(words: Sequence[str], place: Path | None = None) -> PortAndPlace:
    """Return what words name, a port, a cell file or both in either order, beside the file of ``--cell``.

    Other verbs take the cell file before the port. Nobody who has to stop the arm shall have to think of that.

    Raises:
        InputError: two ports or two cell files.
    """
    files = [word for word in words if word.endswith(".toml") or os.path.isfile(word)]
    ports = [word for word in words if word not in files]
    if len(ports) > 1:
        raise InputError(f"{' and '.join(ports)}: give one port", ports=ports)
    cells = files if place is None else [*files, str(place)]
    if len(cells) > 1:
        why = f"{' and '.join(cells)}: give one cell file; a port is a device, or socket://HOST:PORT"
        raise InputError(why, cells=cells)
    return PortAndPlace(ports[0] if ports else None, Path(cells[0]) if cells else None)


def choose_port(given: str | None, place: Path | None, console: Console) -> str:
    """Return the port to open; say where it comes from, unless the command line names it.

    Args:
        given: of the command line; None or `OF_CELL`: that of the environment, or else of `place`.
        place: cell, task or program file, of which only the port is read, so that a cell with another fault can be
            stopped; None: none is known.
        console: output.

    Raises:
        InputError: there is none, or it is not well-formed.
    """
    if given not in (None, OF_CELL):
        return given
    if url := os.environ.get(VARIABLE, ""):
        if fault := port_fault(url) or missing_port(url):
            raise InputError(f"{VARIABLE} = {url!r}: {fault}", variable=VARIABLE, value=url)
        console.say(f"port: {url}, of {VARIABLE}")
        return url
    file = None if place is None else _cell_file(task_or_cell(place))
    found: str | None = None if file is None else file.get(KEY, port(), None)
    if file is not None and found is None:
        _refuse_below_a_table(file)
    if file is None or found is None:
        others = (
            f"or set {VARIABLE}" if file is None else f"set {VARIABLE}, or write {EXAMPLE} in {file.file}"
        )
        raise InputError(f"no port is named: give PORT, such as /dev/mars, {others}", port=None)
    if why := missing_port(found):
        raise file.error_at(KEY, why)
    named = str(file.value[KEY])
    if not os.path.exists(found) and "://" not in found and os.path.exists(named):
        there = os.path.relpath(named, file.file.parent)
        why = f"is beside this file, where there is none; the one of the working folder is {there}"
        raise file.error_at(KEY, why)
    console.say(f"port: {found}, of {file.file}")
    return found


def _refuse_below_a_table(file: Node) -> None:
    """Refuse a port that stands in a table: what is written at the end of a file belongs to its last table."""
    for name, _ in leaves(file.value):
        table, _, last = name.rpartition(".")
        if last == KEY:
            header = f"[[{table.partition('[')[0]}]]" if table.endswith("]") else f"[{table}]"
            raise file.error_at(KEY, f"is in {header}, where it is no port; it belongs above the first table")


def _cell_file(root: Node) -> Node:
    """The cell file that a task or program names, or the file itself."""
    named = root.value.get("cell") if isinstance(root.value, dict) else None
    return Node.of_toml(root["cell"].read(path())) if isinstance(named, str) else root
