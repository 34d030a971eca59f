"""The file of a recording: what a unit was asked, and every byte with its time. No name of a host, port or person."""

from __future__ import annotations

import json
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Any

from arm.io.node import Node
from arm.io.rules import flag, integer, number, tables, text
from driver.record.tape import RECEIVED, SENT, STEP, Event

FORMAT, VERSION = "a465 unit record", 1
_MOST_S = 1e6
_MANNERS = ("echoes", "adapter", "takes_turns")


class Ended(StrEnum):
    """How a recording ended."""

    COMPLETE = "complete"
    SILENT = "nothing came back"
    UNIDENTIFIED = "not identified"
    STOPPED = "stopped answering"
    LOST = "link lost"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class UnitRecord:
    """A recording.

    Attributes:
        seconds: how long the counts were to be read at rest.
        ended: how it ended.
        manners: how the driver found the unit to echo (`driver.line.manners.Manners`), or None.
        events: everything, in its order.
    """

    seconds: float
    ended: Ended
    manners: dict[str, bool] | None
    events: tuple[Event, ...]

    def to_json(self) -> str:
        """Return the text of the file: JSON, an event a line."""
        head = {
            "format": FORMAT,
            "version": VERSION,
            "seconds": self.seconds,
            "ended": str(self.ended),
            "manners": self.manners,
        }
        lines = "".join(f"  {json.dumps(key)}: {json.dumps(value)},\n" for key, value in head.items())
        events = ",\n".join(
            "    " + json.dumps({"t": event.time_s, "kind": event.kind, "data": event.data})
            for event in self.events
        )
        return f'{{\n{lines}  "events": [\n{events}\n  ]\n}}\n'


def read_unit_record(file: Path) -> UnitRecord:
    """Read a recording.

    Raises:
        FileInputError: it cannot be read, or a value breaks a rule.
    """
    root = Node.of_json(file, "unit record")
    root.get("format", text(FORMAT))
    root.get("version", integer(VERSION, VERSION))
    manners: dict[str, bool] | None = None
    if (found := root["manners"]).value is not None:
        manners = {name: found.get(name, flag()) for name in _MANNERS}
    return UnitRecord(
        root.get("seconds", number("s", 0.0, _MOST_S)),
        Ended(root.get("ended", text(*Ended))),
        manners,
        root.get("events", tables(_event)),
    )


def _event(node: Node) -> Event:
    data: Any = node.get("data", text())
    kind = node.get("kind", text(STEP, SENT, RECEIVED))
    return Event(node.get("t", number("s", 0.0, _MOST_S)), kind, data)
