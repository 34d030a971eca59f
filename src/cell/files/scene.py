"""The scene file: an arm among bodies, and questions about it with the answers that are expected, in TOML.

It tests collision checking itself, and answers "how close is this?" for scenes that no plan was made for.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.controller.unit import UNITS, Unit, load_unit
from arm.errors import InputError
from arm.io.toml_reader import TomlTable
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from cell.config.bodies import read_body, read_pose
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.files.task import read_task
from plan.collision.world import World

Pair = frozenset[str]
# Overlap and distance of one configuration; asked clearance over a motion.
QUERY_VERDICTS = ("free", "collides")
MOTION_VERDICTS = ("clear", "too close")


@dataclass(frozen=True)
class Expected:
    """What a question is expected to give; None where nothing is expected. Where all are None, nothing may be too near.

    Attributes:
        verdict: of `QUERY_VERDICTS` or `MOTION_VERDICTS`.
        distance: of the closest pair, smallest over a motion, less the padding, m; negative by the depth of an overlap.
        pair: names of the closest two bodies.
    """

    verdict: str | None = None
    distance: float | None = None
    pair: Pair | None = None


@dataclass(frozen=True)
class Query:
    """One configuration.

    Attributes:
        name: for people.
        q: (6,) rad.
        allowed: pairs that may touch here, besides the scene's.
        expected: answer.
    """

    name: str
    q: Array
    allowed: frozenset[Pair]
    expected: Expected


@dataclass(frozen=True)
class Motion:
    """One straight joint motion.

    Attributes:
        name: for people.
        ends: (2, 6) rad.
        asked: clearance, m.
        allowed: pairs that may touch on it, besides the scene's.
        expected: answer.
    """

    name: str
    ends: Array
    asked: float
    allowed: frozenset[Pair]
    expected: Expected


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene with its questions.

    Attributes:
        file: where it was read.
        unit: whose limits hold.
        robot: the arm, jaws where they are.
        jaw_opening: m.
        bodies: that stand still, cubes included.
        held: in the jaws, at its pose in the tool frame (`T_tool_held`), or None.
        T_tool_held: 4x4; identity where nothing is held.
        allowed: pairs that may touch, in every question.
        padding: taken off every distance, m.
        queries, motions: the questions.
    """

    file: Path
    unit: Unit
    robot: Robot
    jaw_opening: float
    bodies: tuple[Body, ...]
    held: Body | None
    T_tool_held: Array
    allowed: frozenset[Pair]
    padding: float
    queries: tuple[Query, ...]
    motions: tuple[Motion, ...]

    def world(self, allowed: Iterable[Pair] = ()) -> World:
        """The collision world, with more allowed contacts if given."""
        return World(
            self.robot,
            self.bodies,
            self.held,
            self.T_tool_held,
            self.allowed | frozenset(allowed),
            self.padding,
        )


def read_scene_file(path: Path) -> SceneFile:
    """Read a scene file.

    Keys: `unit`, `tool_length_mm`, `jaw_opening_mm`, `padding_mm`, `allowed` (pairs of names that may touch; nothing
    else may); `[[bodies]]` (see `cell.config.bodies`); `[[cubes]]` and `[held]`, one cube in the jaws with
    its pose in the tool frame (`name`, `size_mm`, `centre_mm`, `rpy_deg`); `[[queries]]` (`name`, `q_deg`)
    and `[[motions]]` (`name`, `from_deg`, `to_deg`, `asked_mm`), each with `allowed` of its own and what is
    expected, none of it required: `verdict`, `distance_mm` or `clearance_mm`, `pair`. Where nothing is,
    `free` or `clear` is. See `docs/scenes.md`.

    Raises:
        InputError: with file, key, value, unit and rule.
    """
    root = TomlTable.read(path)
    if "task" in root or "q_start_deg" in root:
        kind = "task" if "task" in root else "cell"
        raise InputError(
            f"{path}: is a {kind} file; check takes a plan and its task (a465 check PLAN.json TASK.toml), a scene file "
            f"with questions of its own (docs/scenes.md), or a {kind} file with a configuration (--q)",
            file=str(path),
        )
    unit = load_unit(root.text("unit", choices=UNITS))
    jaw_opening = root.number("jaw_opening_mm", "mm", 1, 100) / 1e3
    robot = load_a465(root.number("tool_length_mm", "mm", 1, 1000) / 1e3, jaw_opening)
    tables = [*root.tables("bodies"), *root.tables("cubes")]
    bodies = [read_body(table, "wall") for table in root.tables("bodies")]
    bodies += [_cube(table) for table in root.tables("cubes")]
    held = None
    if "held" in root:
        tables.append(root.table("held"))
        held = _cube(root.table("held"))

    names = {b.name for b in robot.bodies}
    for table, body in zip(tables, [*bodies, held] if held else bodies, strict=True):
        if body.name in names:
            raise table.error("name", "is used twice, or is a body of the arm; names must differ")
        names.add(body.name)
    scene = SceneFile(
        file=path,
        unit=unit,
        robot=robot,
        jaw_opening=jaw_opening,
        bodies=tuple(bodies),
        held=held,
        T_tool_held=held.T_base_body if held else transform(),
        allowed=_allowed(root, names),
        padding=root.number("padding_mm", "mm", 0, 100, default=0.0) / 1e3,
        queries=tuple(_query(table, unit, names) for table in root.tables("queries")),
        motions=tuple(_motion(table, unit, names) for table in root.tables("motions")),
    )
    root.finish()
    return scene


def _cube(table: TomlTable) -> Body:
    """A cube; that in the jaws has its pose in the tool frame."""
    name = table.text("name")
    size = table.number("size_mm", "mm", 5, 80, default=40.0) / 1e3
    pose = read_pose(table, "centre_mm")
    table.finish()
    return Body(name, Box((size, size, size)), pose, "cube")


def _query(table: TomlTable, unit: Unit, names: set[str]) -> Query:
    query = Query(
        table.text("name"),
        _configuration(table, "q_deg", unit),
        _allowed(table, names),
        _expected(table, QUERY_VERDICTS, "distance_mm", names),
    )
    table.finish()
    return query


def _motion(table: TomlTable, unit: Unit, names: set[str]) -> Motion:
    motion = Motion(
        table.text("name"),
        frozen([_configuration(table, key, unit) for key in ("from_deg", "to_deg")]),
        table.number("asked_mm", "mm", 0, 1000) / 1e3,
        _allowed(table, names),
        _expected(table, MOTION_VERDICTS, "clearance_mm", names),
    )
    table.finish()
    return motion


def _configuration(table: TomlTable, key: str, unit: Unit) -> Array:
    q = np.radians(table.numbers(key, 6, "deg", -360, 360))
    rule = beyond_limits(q, unit)
    if rule:
        raise table.error(key, rule)
    return frozen(q)


def beyond_limits(q: Array, unit: Unit) -> str:
    """The rule that a configuration (6,) rad breaks, or ""."""
    for joint, (value, low, high) in enumerate(zip(q, unit.lower, unit.upper, strict=True), start=1):
        if not low <= value <= high:
            return f"J{joint} must be from {np.degrees(low):.1f} to {np.degrees(high):.1f} deg on {unit.name}"
    return ""


def read_surroundings(path: Path) -> SceneFile:
    """A scene file; or a cell file, or a task file with its cell, as a scene without boards and cubes: they are seen.

    Raises:
        InputError: it is none of them, or has a mistake.
    """
    root = TomlTable.read(path)
    if "task" in root:
        return _of_cell(read_task(path).cell)
    if "q_start_deg" in root or "camera" in root:
        return _of_cell(read_cell(path))
    return read_scene_file(path)


def _of_cell(cell: Cell) -> SceneFile:
    """Jaws open."""
    none: frozenset[Pair] = frozenset()
    return SceneFile(
        cell.file, cell.unit, cell.robot(), cell.jaw_opening, cell.fixed, None, transform(), none, 0.0, (), ()
    )


def _expected(table: TomlTable, verdicts: tuple[str, ...], distance_key: str, names: set[str]) -> Expected:
    return Expected(
        table.text("verdict", choices=verdicts) if "verdict" in table else None,
        table.number(distance_key, "mm", -1000, 10000) / 1e3 if distance_key in table else None,
        _pair(table, "pair", table.value("pair", "two names"), names) if "pair" in table else None,
    )


def _allowed(table: TomlTable, names: set[str]) -> frozenset[Pair]:
    if "allowed" not in table:
        return frozenset()
    pairs = table.value("allowed", "a list of pairs of names")
    if not isinstance(pairs, list):
        raise table.error("allowed", "must be a list of pairs of names")
    return frozenset(_pair(table, "allowed", pair, names) for pair in pairs)


def _pair(table: TomlTable, key: str, value: object, names: set[str]) -> Pair:
    if not isinstance(value, list) or not all(isinstance(n, str) for n in value) or len(set(value)) != 2:
        raise table.error(key, "must name two different bodies")
    unknown = sorted(set(value) - names)
    if unknown:
        raise table.error(
            key, f"names {unknown[0]!r}, which is no body; there are {', '.join(sorted(names))}"
        )
    return frozenset(value)
