"""A list of poses and configurations in JSON, CSV or NumPy's .npy format, as other programs for this arm use.

The content of a file decides its format. The frame of a pose (flange or tool) and the unit of angles are never guessed:
flange and finger tips are 134 mm apart.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import A465Error, FileInputError
from arm.io.foreign import binary, markup
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import is_number, line, number, numbers, rule_of, zero_or
from arm.io.storage import read_bytes
from arm.number_rows import cells_of, has_decimal_commas, has_empty_cell, help_of, is_header, unit_of
from arm.number_rows import is_number as is_number_word
from arm.se3 import Array, orthonormalised
from cell.files.reading import ANGLES, FRAMES, LENGTHS, Reading

WAYS = ("transit", "line")
JAWS = {"open": 0.0, "close": 1.0}
FARTHEST, NEAREST = 5.0, 2e-3  # largest coordinate in the base frame, and least largest one, m
MOST = 5000  # entries
_LEAST_RANGE = 5e-5  # m, of a direction that is free within limits
PRINTED = 1e-3  # tolerance of a rotation matrix that was printed with few digits
_POSES = {12: "the upper three rows of a 4x4 pose", 16: "a 4x4 pose"}  # by their count of numbers
_BY_KEY = ("T_base_flange", "T_base_tool", "q_rad", "q_deg")
_AT_A_POSE = ("by", "free", "tilt_deg", "ranges", "approach_mm", "retract_mm", "within_mm", "speed_mm_s")


JAWS_RULE = rule_of(
    "open, close, or a number from 0 (open) to 1 (shut)",
    lambda v: v in JAWS if isinstance(v, str) else is_number(v) and 0.0 <= v <= 1.0,
    lambda v: float(JAWS.get(v, v)),
)
WITHIN = zero_or(0.05, 1000.0)  # of a corner that is cut
AWAY = zero_or(0.5, 1000.0)  # of an approach or a retract
_RANGES = {
    **{f"{axis}_mm": (axis, numbers(2, "mm", -5000.0, 5000.0)) for axis in "xyz"},
    **{f"r{axis}_deg": (f"r{axis}", numbers(2, "deg", -180.0, 180.0)) for axis in "xyz"},
}


def _ranges(node: Node) -> dict[str, tuple[float, float]]:
    """Read limits of directions, such as ``{"rz_deg": [-30, 60], "x_mm": [-10, 10]}``."""
    if not isinstance(node.value, dict):
        raise node.error("must be an object with a lowest and a highest value for each direction")
    found: dict[str, tuple[float, float]] = {}
    for given in node.value:
        if given not in _RANGES:
            raise node.error_at(given, f"is unknown; must be one of {', '.join(_RANGES)}")
        name, rule = _RANGES[given]
        low, high = node.get(given, rule)
        if given.endswith("_mm") and 0.0 < max(abs(low), abs(high)) < _LEAST_RANGE:
            raise node.error_at(
                given, f"must be [0, 0], or reach {1e3 * _LEAST_RANGE:g} mm or more", "is it in metres?"
            )
        if low > high:
            raise node.error_at(given, "must be the lowest value, then the highest")
        found[name] = float(low), float(high)
    return found


RANGES = Rule("a table of two limits each", _ranges)


class EntryValues(Keys):
    """Values of an entry that are used unchanged: see `plan.program.goals.target.Target`; SI units.

    Attributes:
        dwell_s: pause at the entry, s.
        jaws: closed fraction of the jaws' stroke at the entry, 0 open to 1 shut; None: unchanged.
    """

    by: str = key("by", line(*WAYS), "transit")
    free: str = key("free", line(), "")
    tilt: float = key("tilt_deg", number("deg", 0.0, 90.0), 0)
    ranges: dict[str, tuple[float, float]] = key("ranges", RANGES, {})
    approach: float = key("approach_mm", AWAY, 0)
    retract: float = key("retract_mm", AWAY, 0)
    within: float = key("within_mm", WITHIN, 0)
    speed: float | None = key("speed_mm_s", number("mm/s", 0.1, 2000.0), None)
    dwell_s: float = key("dwell_s", number("s", 0.0, 60.0), 0)
    jaws: float | None = key("jaws", JAWS_RULE, None)


_USUAL = EntryValues.read(Node(Path(), "", {})).values_of(EntryValues)  # of an entry that is numbers alone


class Entry(EntryValues):
    """A pose or configuration of the list, or an action at the previous one: `EntryValues`, and where it is.

    Attributes:
        key: position in the file, such as ``entries[2]`` or ``row 3``.
        name: unique name for messages.
        frame: frame of the pose, of `FRAMES`; empty if the entry is no pose.
        T: pose, 4x4, in the base frame, m; None if the entry is no pose.
        q: configuration (n,), rad (m), or None.
        taught: what ``a465 teach`` recorded beside the configuration; empty if nothing.
        in_deg: whether the file gives the configuration in deg.
    """

    key: str
    name: str
    frame: str = ""
    T: Array | None = None
    q: Array | None = None
    taught: Mapping[str, Any] = field(default_factory=dict)
    in_deg: bool = False


@dataclass(frozen=True, eq=False)
class PoseList:
    """Content of a pose list file; `entries` in order, at least one."""

    file: Path
    entries: tuple[Entry, ...]


def read_pose_list(path: Path, reading: Reading | None = None) -> PoseList:
    """Read a pose list.

    JSON: an object with ``entries`` and optionally ``frame``, ``angles``, ``lengths``, or only the list of entries. An
    entry is an object with one of ``T_base_flange``, ``T_base_tool``, ``q_rad``, ``q_deg``, or a list of numbers. CSV:
    one entry per row, of 16 or 12 numbers (pose, row by row) or 6 (configuration). npy: an array of the same.

    Args:
        path: the file.
        reading: interpretation of bare numbers where the file does not specify it.

    Raises:
        FileInputError: a value is wrong; names file, row or entry, value and rule.
    """
    reading, data = reading or Reading(), read_bytes(path, "pose list")
    file = Node(path, "", None)
    if data.startswith(b"\x93NUMPY"):
        found = _of_array(file, data, reading)
    elif data.lstrip()[:1] in (b"{", b"[") or path.suffix == ".toml":
        found = _of_json(path, reading)
    else:
        found = _of_text(file, data, reading)
    entries = list(islice(found, MOST + 1))
    if len(entries) > MOST:
        raise file.error(f"has more than {MOST} entries, the limit of a plan")
    if not entries:
        raise file.error("has no entries; must have at least one pose or configuration")
    seen: dict[str, str] = {}
    for entry in entries:
        if entry.name in seen:
            rule = f"is also the name of {seen[entry.name]}; names must differ"
            raise Node(path, entry.key, entry.name).error(rule)
        seen[entry.name] = entry.key
    return PoseList(path, tuple(entries))


def _of_array(file: Node, data: bytes, reading: Reading) -> Iterator[Entry]:
    try:
        array = np.load(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError, MemoryError, OverflowError) as error:
        raise file.error(f"is not a .npy file of numbers: {error}") from error
    if array.dtype.kind not in "fiu":
        raise FileInputError(file.file, "", str(array.dtype), "must be an array of real numbers")
    if array.ndim and array.shape[-2:] in ((4, 4), (3, 4)):
        array = array.reshape(-1, array.shape[-2] * 4)
    array = array.reshape(1, -1) if array.ndim == 1 else array
    if array.ndim != 2:
        rule = "must be an array of (n, 4, 4), (n, 16), (n, 12) or (n, 6)"
        raise FileInputError(file.file, "", list(array.shape), rule)
    if array.shape[1] not in (reading.joints, *_POSES) and array.shape[0] in (reading.joints, *_POSES):
        rule = "has a pose or configuration in each column; must have it in each row"
        raise FileInputError(file.file, "", list(array.shape), rule, "transpose it")
    for place, row in enumerate(array.astype(float), start=1):
        yield _bare(Node(file.file, f"row {place}", row.tolist()), row, place, reading)


def _of_text(file: Node, data: bytes, reading: Reading) -> Iterator[Entry]:
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        what = binary(data) or "is neither text (CSV, JSON) nor a .npy file"
        raise file.error(f"{what}; a list of poses is CSV, JSON or .npy") from error
    if foreign := markup(text) or ("\0" in text and binary(data)):
        raise file.error(f"{foreign}; a list of poses is CSV, JSON or .npy")
    count, is_first = 0, True
    for row, words in enumerate(text.splitlines(), start=1):
        if not (cells := cells_of(words)):
            continue
        node = Node(file.file, f"row {row}", words.strip())
        if is_first and cells[0].lower() == "time_s":
            raise file.error("is a table of samples, as a465 export writes it, and no list of poses")
        if is_first and is_header(cells):
            is_first = False
            _require_units(node, re.split(r"[,;\t]", words.replace('"', "")), reading)
            continue  # the names of the columns
        is_first = False
        numbers = [cell for cell in cells if is_number_word(cell)]
        wrong = next((cell for cell in cells if not is_number_word(cell)), None)
        if wrong is not None:
            raise replace(node, value=wrong).error("must be a number", help_of(wrong, len(numbers)))
        if has_decimal_commas(words):
            raise node.error("has decimal commas: decimals have a point")
        if has_empty_cell(words):
            raise node.error("has an empty cell; every cell must be a number")
        count += 1
        values = np.array([float(c) for c in cells])
        yield _bare(replace(node, value=values.tolist()), values, count, reading)


def _require_units(node: Node, names: Sequence[str], reading: Reading) -> None:
    """Refuse columns that are named in another unit than their numbers would be read in."""
    for kind, given, units in (("angles", reading.angles, ANGLES), ("lengths", reading.lengths, LENGTHS)):
        for name in names:
            unit = unit_of(name.strip())
            if given is not None and unit in units and unit != given:
                rule = f"is in {unit} by its name, but numbers are read in {given}; give --{kind} {unit}"
                raise replace(node, value=name).error(rule)


def _help_of_count(count: int, kinds: Mapping[int, str], reading: Reading) -> str:
    """Return what a row of another count of numbers than a pose or a configuration may be."""
    if count == 7 and reading.angles is None:
        return "x y z and a quaternion are not read: give 12 or 16 numbers"
    if count - 1 in kinds:
        return "is its first number that of the row? Leave it out"
    return "a pose is one row" if reading.frame and count == 4 else ""


def _bare(node: Node, values: Array, number: int, reading: Reading) -> Entry:
    """Return an entry of bare numbers; their count decides its kind."""
    kinds = {reading.joints: "six joint angles" if reading.joints == 6 else "joint positions", **_POSES}
    if len(values) not in kinds:
        counts = ", ".join(f"{n} ({what})" for n, what in sorted(kinds.items()))
        told = replace(node, value=f"{len(values)} numbers")
        raise told.error(f"must be one of {counts}", _help_of_count(len(values), kinds, reading))
    if not np.isfinite(values).all():
        raise node.error("must be finite numbers")
    bare = replace(node, value=None)  # the numbers are right
    if len(values) not in _POSES:
        if reading.angles is None and reading.frame:
            why = "is no pose: a pose is 12 or 16 numbers, and x y z roll pitch yaw is not read"
            raise bare.error(why, f"for {kinds[len(values)]} give --angles rad or deg in place of --frame")
        if reading.angles is None:
            raise bare.error(f"has {kinds[len(values)]} without a unit; give --angles rad or deg")
        q = reading.q(node, values, reading.angles)
        name, in_deg = f"configuration {number}", reading.angles == "deg"
        return Entry(key=node.key, name=name, q=q, in_deg=in_deg, **_USUAL)
    if reading.frame is None:
        why = "is a pose without a frame; give --frame flange (as in ctu_crs) or --frame tool (finger tips)"
        raise bare.error(why)
    T = _pose(node, values, reading.lengths)
    return Entry(key=node.key, name=f"pose {number}", frame=reading.frame, T=T, **_USUAL)


def _pose(node: Node, values: Array, lengths: str) -> Array:
    """Return the rigid transform of three or four rows of four numbers."""
    T = np.eye(4)
    T[: len(values) // 4] = values.reshape(-1, 4)
    T[:3, 3] *= LENGTHS[lengths]
    if not np.abs(T[:3, 3]).max() <= FARTHEST:
        rule = f"is a position in {lengths}; must be within {FARTHEST:g} m of the base"
        help = 'for positions in mm give --lengths mm, or "lengths": "mm" in the file'
        raise replace(node, value=values[3:12:4].tolist()).error(rule, help)
    if lengths == "mm" and 0.0 < np.abs(T[:3, 3]).max() < NEAREST:
        rule = (
            f"is a position in {lengths}; must be {1e3 * NEAREST:g} mm or more from the base along one axis"
        )
        raise replace(node, value=values[3:12:4].tolist()).error(
            rule, "is it in m? then leave out --lengths mm"
        )
    try:
        return orthonormalised(T, tolerance=PRINTED)
    except A465Error as error:
        help = "give it row by row, the last row being 0 0 0 1"
        raise node.error(f"is not a pose: {error}", help) from error


def _of_json(path: Path, reading: Reading) -> Iterator[Entry]:
    root = Node.of_json(path, "list")
    if isinstance(root.value, dict):
        if any(name in root for name in _BY_KEY):
            raise root.error("is one entry, must be a list of entries", "put it in [ ]")
        given = _ListKeys.read(root)
        stated = {name: value for name, value in vars(given).items() if name != "entries" and value}
        for name in reading.options:
            if name in stated and stated[name] != (other := getattr(reading, name)):
                raise root[name].error(f"differs from --{name} {other}", "give one of both")
        reading = replace(reading, **stated)
        root = root["entries"]
    for place, node in enumerate(root.items(), start=1):
        yield _entry(node, place, reading)


def _flat(*counts: int) -> Rule[Array]:
    """Return the rule for numbers in a list, or in a list of rows, row by row."""
    words = " or ".join(map(str, counts)) + " numbers"

    def read(node: Node) -> Array:
        rows = isinstance(node.value, list) and bool(node.value) and isinstance(node.value[0], list)
        values = np.ravel(node.read(numbers((None, None)) if rows else numbers(None)))
        if rows and np.shape(node.value) not in ((4, 4), (3, 4)):
            raise node.error(
                "must be 4 (or 3) rows of 4 numbers" if counts else "must be one list of numbers"
            )
        if counts and len(values) not in counts:
            raise node.error(f"must be {words}, not {len(values)}")
        return values

    return Rule(words, read)


class _ListKeys(Keys):
    entries: list[Any] = key("entries", rule_of("a list", lambda v: isinstance(v, list), list))
    frame: str | None = key("frame", line(*FRAMES), None)
    angles: str | None = key("angles", line(*ANGLES), None)
    lengths: str | None = key("lengths", line(*LENGTHS), None)


class _EntryKeys(EntryValues):
    T_base_flange: Array | None = key("T_base_flange", _flat(12, 16), None)
    T_base_tool: Array | None = key("T_base_tool", _flat(12, 16), None)
    q_rad: Array | None = key("q_rad", _flat(), None)
    q_deg: Array | None = key("q_deg", _flat(), None)
    name: str | None = key("name", line(), None)
    taught: dict[str, Any] = key("taught", rule_of("an object", lambda v: isinstance(v, dict), dict), {})


def _entry(node: Node, place: int, reading: Reading) -> Entry:
    if isinstance(node.value, list):
        return _bare(node, node.read(_flat()), place, reading)
    if not isinstance(node.value, dict):
        raise node.error("must be an object or a list of numbers")
    keys = _EntryKeys.read(node)
    given = [key for key in _BY_KEY if key in node]
    if len(given) > 1:
        raise node[given[1]].error(f"cannot be combined with {given[0]}; an entry has one of them")
    at_a_pose = [key for key in _AT_A_POSE if key in node]
    if at_a_pose and (not given or given[0].startswith("q_")):
        raise node[at_a_pose[0]].error("needs a pose (T_base_flange or T_base_tool)")
    if not given and "jaws" not in node and "dwell_s" not in node:
        raise node.error(f"must have one of {', '.join(_BY_KEY)}, or only jaws or dwell_s")
    kind = given[0] if given else "rest"
    named, frame, T, q = "rest", "", None, None
    if kind.startswith("T_"):
        named, frame = "pose", kind.removeprefix("T_base_")
        T = _pose(node[kind], getattr(keys, kind), reading.lengths)
    elif kind.startswith("q_"):
        named, q = "configuration", reading.q(node[kind], getattr(keys, kind), kind.removeprefix("q_"))
    named = keys.name or f"{named} {place}"
    usual = {"taught": keys.taught, **keys.values_of(EntryValues)}
    return Entry(key=node.key, name=named, frame=frame, T=T, q=q, in_deg=kind == "q_deg", **usual)
