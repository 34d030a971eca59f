"""``a465 teach``: append the present pose of the arm to a list of poses."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped, FileInputError
from arm.io.claim import Claim
from arm.io.node import Node
from arm.io.rules import line, numbers, rigid
from arm.io.storage import read_json, write_atomic
from arm.numerics.products import norm
from cell.commands.manual.reading import Reading, print_reading, read_arm
from cell.config.cell import Cell
from cell.console import Console
from cell.doctor.devices import FIRMWARE
from cell.files.pose_list import PoseList, read_pose_list
from cell.files.reading import Reading as Interpretation
from cell.files.task import cell_of
from cell.session.ports import choose_port
from driver.mars.identity import identified
from driver.mars.refusals import refuse_unhomed

FRAME = "tool"
OTHERS_S = 5.0  # wall time for another that writes the same list
LONGEST_NAME = 100
SAME_MM = 0.05  # of the recorded tool position, which is rounded
DIGITS = 5  # of angles in deg; a count is 0.0009 deg


def teach_step(
    pose_list: Path, place: Path, port: str | None, name: str | None, console: Console
) -> dict[str, Any]:
    """Append where the arm is to a JSON list of poses, which is created if there is none. Nothing is set or moved.

    Args:
        pose_list: the list; all that it has stays.
        place: cell or task file.
        port: of the controller; see `cell.session.ports.choose_port`.
        name: of the entry; None: the next ``pose N``.
        console: output.

    Raises:
        InputError: a file, value or port is wrong, the name is taken, or the list is no JSON.
        ImpossibleError: the unit was not homed, or the arm is outside the limits of planning.
        ExecutionStopped: the arm moves, or the unit does not answer.
    """
    _read(pose_list, name)  # a list that cannot be extended is refused before the port is opened
    cell = cell_of(place)
    if pose_list.exists():
        for told in taught_otherwise(read_pose_list(pose_list, Interpretation(FRAME, "deg")), cell):
            console.say(f"NOTE: {pose_list}: {told}")
    port = choose_port(port, place, console)
    with console.doing("asking"), identified(port, FIRMWARE) as (link, _):
        reading = read_arm(link, cell)
    state = reading.to_json()
    print_reading(state, console)
    if state["moving"]:
        raise ExecutionStopped("the arm moves, so its pose is not taught", **state)
    refuse_unhomed(cell.unit, reading.counts or ())
    # of two at the same time, none loses the other's pose
    with Claim(f"file {pose_list.resolve()}", wait_s=OTHERS_S):
        content, names = _read(pose_list, name)
        name = name or _next(names)
        content["entries"].append(_entry(name, reading))
        write_atomic(pose_list, _text(content))
    count = len(content["entries"])
    console.say(f"{pose_list}: {name!r} is entry {count - 1}, of {count}")
    return {"list": str(pose_list), "name": name, "entries": count, "entry": content["entries"][-1]}


def _read(file: Path, name: str | None) -> tuple[dict[str, Any], set[str]]:
    """The content of a list as an object with entries, and the names that are taken.

    Raises:
        FileInputError: the file is no JSON list of poses, or has an entry of that name.
    """
    if name is not None:
        Node(file, "name", name).read(line())
        if len(name) > LONGEST_NAME or not name.isprintable() or not name.strip():
            rule = f"must not be empty, and at most {LONGEST_NAME} printable characters"
            raise FileInputError(file, "name", name[:LONGEST_NAME], rule)
    if file.suffix.lower() in (".csv", ".npy", ".txt", ".toml"):
        help = "the list comes first, then the cell or task file"
        raise FileInputError(file, "", None, "is no JSON: teach appends to lists in JSON only", help)
    if not file.exists():
        if file.suffix.lower() != ".json":
            help = "the name of a pose is given by --name"
            raise FileInputError(file, "", None, "must end in .json, as it is a list of poses", help)
        return {"frame": FRAME, "angles": "deg", "entries": []}, set()
    content = read_json(file)
    listed = read_pose_list(file, Interpretation(FRAME, "deg"))  # refuses what plan would
    names = {entry.name for entry in listed.entries}
    if name in names:
        raise FileInputError(file, "name", name, "is in the list already; names must differ")
    return (content if isinstance(content, dict) else {"entries": content}), names


def _next(names: set[str]) -> str:
    return next(name for n in range(1, len(names) + 2) if (name := f"taught {n}") not in names)


def _entry(name: str, reading: Reading) -> dict[str, Any]:
    """The entry of a pose: its joint angles, and a record of the tool's pose and the counters."""
    state = reading.to_json()
    q = reading.q()
    return {
        "name": name,
        "q_deg": [round(float(d), DIGITS) + 0.0 for d in np.degrees([] if q is None else q)],
        "taught": {
            "T_base_tool": [[round(v, 7) + 0.0 for v in row] for row in state["T_base_tool"]],
            "counts": state["counts"],
            "unit": state["unit"],
            "when": datetime.now().astimezone().isoformat(timespec="seconds"),
        },
    }


def taught_otherwise(poses: PoseList, cell: Cell) -> list[str]:
    """Return a line for each entry whose record tells that arm or tool were calibrated otherwise when it was taught."""
    lines = []
    for entry in poses.entries:
        if entry.q is None or not {"unit", "counts", "T_base_tool"} <= set(entry.taught):
            continue
        node = Node(poses.file, f"{entry.key}.taught", dict(entry.taught))
        of, counts = node.get("unit", line()), node.get("counts", numbers(len(cell.unit.axes)))
        then = node.get("T_base_tool", rigid())
        if of != cell.unit.name:
            lines.append(f"{entry.name!r} was taught on {of}, and this cell has {cell.unit.name}")
            continue
        now = cell.robot().T_base_tool(cell.unit.positions(counts))
        off = 1e3 * float(norm(now[:3, 3] - then[:3, 3]))
        if off > SAME_MM:
            lines.append(
                f"{entry.name!r} was taught with another calibration or tool than this cell has: the tool stood "
                f"{off:.1f} mm from where it was taken to be, and these angles lead it elsewhere; teach it again"
            )
    return lines


def _text(content: dict[str, Any]) -> str:
    """JSON with an entry a line."""
    head = {key: value for key, value in content.items() if key != "entries"}
    lines = [
        f"  {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)},\n" for key, value in head.items()
    ]
    entries = ",\n".join(f"    {json.dumps(entry, ensure_ascii=False)}" for entry in content["entries"])
    return "{\n" + "".join(lines) + f'  "entries": [\n{entries}\n  ]\n}}\n'
