"""The first-day checklist: what must be true before an arm may run unattended, kept in a file beside the cell file.

A tick holds for what it was checked against, which is stored with it: values of the cell file, and digests of what that
names. If any of these changes, the tick is void.
"""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from arm.credentials import hide_credentials
from arm.errors import InputError
from arm.io.keys import Key, Keys, key, read_values
from arm.io.node import REQUIRED, Node, Rule
from arm.io.rules import integer, line, table, text
from arm.io.storage import sha256, write_atomic
from arm.io.toml_reader import read_toml
from arm.io.toml_writer import toml_lines, toml_value
from arm.robot.description import robot_to_json
from cell.config.camera_keys import OF_CELL
from cell.config.cell import Cell, tool_bodies
from cell.config.inputs import Inputs, changes, config_inputs, shortened

FORMAT, VERSION = "a465 checklist", 1
SUFFIX = ".checklist.toml"
_HEAD = """# The first-day checklist of {cell}, written by a465 doctor. A tick holds for what [ITEM.against] has: if
# that changes, the tick is void, and a465 doctor says so. To take a tick back, answer no, or remove its tables.
"""
_SHOWN = 12  # characters of a digest
# Keys of [tool] that nobody measures with callipers
_COMMANDED = ("close_to_mm", "force_v", "grip_height_mm", "grip_tolerance_mm", "settle_s")


@dataclass(frozen=True)
class Item:
    """An item of the checklist.

    Attributes:
        name: in the file.
        row: in tables.
        means: what must be true.
        asks: whether only a person can see it.
        command: returns the command that ticks it.
        against: returns what a tick holds for.
    """

    name: str
    row: str
    means: str
    asks: bool
    command: Callable[[Cell], str]
    against: Callable[[Cell], Inputs]


class Tick(Keys):
    """A tick, as the file has it.

    Attributes:
        when: local time with its offset, ISO 8601.
        by: what ticked it: a port, a camera, or a person.
        found: what was found.
        against: what it holds for, by key.
    """

    when: str = key("when", line())
    by: str = key("by", line())
    found: str = key("found", line())
    against: dict[str, Any] = key("against", table())


@dataclass(frozen=True)
class Status:
    """State of an item in a cell.

    Attributes:
        item: the item.
        tick: its tick, void or not; None: there is none.
        void: why the tick no longer holds, a line for each change.
    """

    item: Item
    tick: Tick | None
    void: tuple[str, ...] = ()

    @property
    def ticked(self) -> bool:
        """Whether there is a tick that holds."""
        return self.tick is not None and not self.void

    def __str__(self) -> str:
        if self.tick is None:
            return "open"
        words = f"{self.tick.when[:10]}, {self.tick.by}: {self.tick.found}".removeprefix(", ")
        return f"void: changed since it was ticked ({words}): {shortened(self.void)}" if self.void else words


def now() -> str:
    """Return the local time with its offset, as ticks have it."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


# -- what a tick holds for


def _unit(cell: Cell) -> dict[str, Any]:
    return {"unit": cell.unit.name}


def _unit_file(cell: Cell) -> dict[str, Any]:
    return {**_unit(cell), "content of the unit's file": cell.nominal_unit.digest[:_SHOWN]}


def _calibration(cell: Cell) -> dict[str, Any]:
    return {"calibration": "none" if cell.calibration is None else cell.calibration.id}


def _shapes(cell: Cell, of_tool: bool) -> str:
    tool, every = tool_bodies(cell.tool), robot_to_json(cell.nominal_robot())["bodies"]
    bodies = [body for body in every if (body["name"] in tool or body["link"] in tool) is of_tool]
    return sha256(bodies)[:_SHOWN]


def _of_bodies(cell: Cell) -> Inputs:
    padding = {"arm_padding_mm": round(1e3 * cell.arm_padding, 6)}
    return {**_unit(cell), **padding, "shapes of the arm's bodies": _shapes(cell, of_tool=False)}


def _of_tool(cell: Cell) -> Inputs:
    measured = {
        name: value
        for name, value in cell.inputs.items()
        if name.startswith("tool.") and name.removeprefix("tool.") not in _COMMANDED
    }
    shapes = {"shapes of the tool's bodies": _shapes(cell, of_tool=True)} if "tool.urdf" in measured else {}
    return {**_unit(cell), **measured, **shapes}


def _of_camera(cell: Cell) -> Inputs:
    keys = config_inputs(read_toml(cell.file))
    of_camera = {name: v for name, v in keys.items() if name.startswith(("look.basler.", "look.video."))}
    return {**of_camera, "lens": cell.camera.lens_digest[:_SHOWN], **_calibration(cell)}


def _of_homed(cell: Cell) -> Inputs:
    return {**_unit_file(cell), **_calibration(cell)}


def _of_limits(cell: Cell) -> Inputs:
    gripper = cell.nominal_unit.gripper
    return {
        **_unit_file(cell),
        "motion.speed_registers": list(cell.speed_registers),
        "motion.acceleration_registers": list(cell.acceleration_registers),
        "energy of the gripper's axis": gripper.registers["REGME"] if gripper.fitted else 0,
    }


# -- the commands that tick it


def _doctor(cell: Cell, *words: str) -> str:
    return shlex.join(["a465", "doctor", "--cell", str(cell.file), *words])


def _port(cell: Cell) -> str:
    return OF_CELL if cell.port is not None else "/dev/mars"


def _by_asking(cell: Cell) -> str:
    return _doctor(cell, "--ask")


def _by_camera(cell: Cell) -> str:
    return _doctor(cell, "--camera", OF_CELL if cell.live_camera.device is not None else "name:MY-CAMERA")


def _by_port(cell: Cell) -> str:
    return _doctor(cell, "--port", _port(cell))


def _by_homing(cell: Cell) -> str:
    port = [] if cell.port is not None else [_port(cell)]
    return f"{shlex.join(['a465', 'home', str(cell.file), *port, '--speed', '0.1'])}, then {_by_port(cell)}"


ITEMS = (
    Item(
        "bodies",
        "bodies compared",
        "the assumed bodies of the arm were compared with the arm",
        True,
        _by_asking,
        _of_bodies,
    ),
    Item("tool", "tool measured", "the tool was measured with callipers", True, _by_asking, _of_tool),
    Item(
        "camera",
        "camera sharp",
        "the camera's image of the cell is sharp and well exposed",
        False,
        _by_camera,
        _of_camera,
    ),
    Item(
        "homed",
        "homed",
        "when last asked, the unit's counters were those of a homed arm",
        False,
        _by_homing,
        _of_homed,
    ),
    Item(
        "limits",
        "limits read back",
        "the unit's registers are those of the unit's file and of the cell file",
        False,
        _by_port,
        _of_limits,
    ),
    Item(
        "stop",
        "emergency stop",
        "the emergency stop was tried, and the arm power went off",
        True,
        _by_asking,
        _unit,
    ),
)
ITEM = {item.name: item for item in ITEMS}


# -- the file


def checklist_file(cell_file: Path) -> Path:
    """Return the file of a cell's checklist, beside the cell file."""
    return cell_file.with_suffix(SUFFIX)


def read_ticks(cell_file: Path) -> dict[str, Tick]:
    """Read the ticks of a cell's checklist by the names of their items; none if there is no file.

    Raises:
        FileInputError: it cannot be read, or a value breaks a rule.
    """
    file = checklist_file(cell_file)
    if not file.exists():
        return {}
    tick = Rule("a tick", Tick.read)
    values = read_values(
        {
            "format": Key("format", text(FORMAT), REQUIRED),
            "version": Key("version", integer(VERSION, VERSION), REQUIRED),
            **{item.name: Key(item.name, tick, None) for item in ITEMS},
        },
        Node.of_toml(file),
    )
    return {item.name: values[item.name] for item in ITEMS if values[item.name] is not None}


def write_ticks(cell_file: Path, ticks: Mapping[str, Tick]) -> None:
    """Write the checklist of a cell, whole or not at all.

    Raises:
        InputError: it cannot be written.
    """
    parts = [_HEAD.format(cell=cell_file.name), *toml_lines({"format": FORMAT, "version": VERSION})]
    for name, tick in ticks.items():
        stated = {"when": tick.when, "by": tick.by, "found": tick.found}
        parts += [f"\n[{name}]", *toml_lines(stated), f"\n[{name}.against]"]
        parts += [f"{toml_value(where)} = {toml_value(value)}" for where, value in tick.against.items()]
    write_atomic(checklist_file(cell_file), "\n".join(parts) + "\n")


def tick_of(cell: Cell, name: str, by: str, found: str) -> Tick:
    """Return a tick of today that holds for the cell as it is. User names and passwords are left out."""
    words = ("".join(c if c.isprintable() else "?" for c in hide_credentials(text)) for text in (by, found))
    return Tick(when=now(), by=next(words), found=next(words), against=_present(cell, ITEM[name]))


def statuses(cell: Cell) -> tuple[Status, ...]:
    """Return the state of each item.

    Raises:
        FileInputError: the checklist cannot be read.
    """
    ticks = read_ticks(cell.file)
    return tuple(_status(cell, item, ticks.get(item.name)) for item in ITEMS)


def _status(cell: Cell, item: Item, tick: Tick | None) -> Status:
    compared = cell.arm_compared.strip()
    if item.name == "bodies" and compared and tick is None:
        return Status(item, Tick(when="", by="the cell file", found=f"arm_compared = {compared}", against={}))
    if tick is None:
        return Status(item, None)
    return Status(item, tick, tuple(changes(tick.against, _present(cell, item))))


def _present(cell: Cell, item: Item) -> dict[str, Any]:
    return {
        where: hide_credentials(value) if isinstance(value, str) else value
        for where, value in item.against(cell).items()
    }


def note_of_open(cell: Cell) -> str | None:
    """Return one line about open items, for a person who lets a real arm move; None if there is none."""
    see = f"a465 doctor --cell {shlex.quote(str(cell.file))} lists them"
    try:
        left = [status.item.row for status in statuses(cell) if not status.ticked]
    except InputError as error:
        return f"note: the first-day checklist cannot be read: {error}"
    if not left:
        return None
    return f"note: {len(left)} of {len(ITEMS)} items of the first-day checklist are open ({', '.join(left)}); {see}"
