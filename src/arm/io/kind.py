"""Kinds of this project's files, recognised by their keys: a file of another kind than belongs in a place is told."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.errors import FileInputError
from arm.io.storage import open_file, read_json
from arm.io.toml_reader import read_toml

LONGEST_LINE = 10_000  # of the first record of a log


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        words: what it is.
        marks: sets of keys of which each is enough: together only this kind has them; one with [] holds a list.
        use: where such a file belongs.
    """

    words: str
    marks: tuple[frozenset[str], ...]
    use: str


def _kind(words: str, marks: str, use: str) -> Kind:
    return Kind(words, tuple(frozenset(one.split()) for one in marks.split(" or ")), use)


KINDS = {  # the first of whose sets of marks one is there
    "plan": _kind("a plan", "provenance steps[]", "execute, check and preview take it"),
    "answer": _kind("what plan --json printed", "plan plan_sha256 moves[]", "plan -o FILE writes the plan"),
    "report": _kind("the report of a run", "cubes_planned plan_sha256", "a465 report takes its folder"),
    "log": _kind("the log of a run", "t kind", "preview and export take it"),
    "corners": _kind(
        "a file of recorded corners", "camera board scenes[]", "a465 look --detections takes it"
    ),
    "look": _kind("a look", "scenes[]", "a465 plan TASK --look FILE makes the plan of it"),
    "trajectory": _kind("a JointTrajectory", "joint_names[] points[]", "a465 certify takes it"),
    "unit record": _kind("the record of a unit", "manners events[]", "a465 record --compare takes it"),
    "recording": _kind("a recording of an arm", "poses", "a465 calibrate hand-eye takes it"),
    "nao recording": _kind("a recording of a NAO", "images", "a465 calibrate kinematic takes it"),
    "list": _kind("a list of poses", "entries[]", "a465 plan CELL POSES takes it"),
    "study": _kind("a study file", "task vary or task stages or task points", "a465 study takes it"),
    "unit": _kind("a unit file", "registers homing", 'a cell file names it: unit = "..."'),
    # also without the key that names the kind: that it is missing is then told
    "task": _kind("a task file", "task or from_board cell", "look, reach, plan and run take it"),
    "program": _kind("a program file", "program or steps[] cell", "reach, plan and run take it"),
    "calibration": _kind(
        "a calibration of an arm", "joint_offsets_rad[]", "a cell file names it as calibration"
    ),
    "camera": _kind("a camera file", "intrinsics", "a cell file names it as camera"),
    "cell": _kind("a cell file", "unit camera", 'a task file names it: cell = "..."'),
    "arm": _kind("an arm file", "arm q_start[] or urdf end_frame", "a465 plan ARM POSES takes it"),
    "faults": _kind("a file of faults", "fault[]", "a465 emulate --fault takes it"),
    "scene": _kind("a scene file", "tool_length_mm", "a465 check takes it"),
    "target": _kind("a target file", "squares[]", "calibrate takes it"),
    "wire": _kind("a wire file", "line_mm[]", "a program names it as line_of"),
    "board": _kind("a board file", "markers[] centre_mm[]", "a cell file names it in boards.files"),
    "world": _kind("a world file", "boards[]", "give it with --world"),
    "tool": _kind("a tool file", "bodies[] origin_mm[]", "a cell file names it as tool.bodies"),
    "samples": Kind("a table of samples", (), "a465 export writes it"),  # told by its first line
}
_INSTEAD: dict[tuple[str, tuple[str, ...]], str] = {  # by what a file is and what belongs there, what helps
    ("cell", ("unit",)): "give the unit that it names",
    ("task", ("recording",)): "--collect TASK makes a recording in its cell",
}
_POSE_SIZES = (6, 12, 16)  # numbers in a row of a list of poses


def kind_of(value: object) -> str:
    """Return the name in `KINDS` of the kind that the content of a file shows; "" if it shows none."""
    if not isinstance(value, dict):
        return ""
    there = {name for key, one in value.items() for name in (key, f"{key}[]" * isinstance(one, list))}
    return next((name for name, kind in KINDS.items() if any(marks <= there for marks in kind.marks)), "")


def require_kind(path: Path, value: object, *wanted: str) -> None:
    """Refuse content that shows another kind than belongs there; content that shows none passes.

    Args:
        path: the file.
        value: its content.
        wanted: names in `KINDS`; none: every kind may be there.

    Raises:
        FileInputError: names what the file is, what belongs there, and where the file belongs.
    """
    found = kind_of(value)
    if wanted and found and found not in wanted:
        *others, last = (KINDS[name].words for name in wanted)
        before = ", ".join(words.removesuffix(" file") for words in others)
        belongs = f"{before} or {last}" if others else last
        rule = f"is {KINDS[found].words}, and {belongs} belongs here"
        help = _INSTEAD.get((found, wanted), KINDS[found].use)
        raise FileInputError(path, "", None, rule, help)


def read_kind(path: Path, read: Callable[[Path], Any], *wanted: str) -> Any:
    """Read a file by `read_toml` or `read_json`, and require its kind as `require_kind` does.

    Raises:
        FileInputError: it cannot be read, or is of another kind, perhaps in the other format.
    """
    try:
        value = read(path)
    except FileInputError:
        require_kind(path, read_any(path), *wanted)
        raise
    require_kind(path, value, *wanted)
    return value


def read_any(path: Path) -> Any:
    """Return the content of a TOML or JSON file, or what the first line of a log holds; None of any other file."""
    for read in (read_json, read_toml, _first_line):
        with suppress(FileInputError):
            return read(path)
    return None


def kind_of_file(path: Path) -> str:
    """Return the name in `KINDS` of what a file of any format is; "" if nothing shows it."""
    return kind_of(read_any(path)) or _kind_of_table(path)


def words_of(path: Path) -> str:
    """Return what a file is, in words; "a file" if nothing shows it."""
    kind = kind_of_file(path)
    return KINDS[kind].words if kind else "a file"


def _kind_of_table(path: Path) -> str:
    """Return the kind of a CSV file: samples as of ``a465 export``, a board file or a list of poses."""
    with suppress(FileInputError), open_file(path, "log") as stream:
        lines = [stream.readline(LONGEST_LINE).decode("utf-8-sig", "replace") for _ in range(7)]
        rows = [re.findall(r"[^,;\s]+", line.partition("#")[0]) for line in lines]
        if rows[0][:1] == ["time_s"]:
            return "samples"
        numbers = [len(row) for row in rows if row and all(map(_is_number, row))]
        if numbers == [2] * 5 == [len(row) for row in rows[:5]]:
            return "board"
        if numbers and all(count in _POSE_SIZES for count in numbers):
            return "list"
    return ""


def _is_number(word: str) -> bool:
    with suppress(ValueError):
        float(word)
        return True
    return False


def _first_line(path: Path) -> Any:
    with open_file(path, "log") as stream, suppress(ValueError, RecursionError):
        return json.loads(stream.readline(LONGEST_LINE))
    return None
