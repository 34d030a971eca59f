"""The scene file (TOML): an arm among bodies, with queries and motions and their expected results.

It tests collision checking itself, and measures distances in scenes without a plan.
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
# A query tests for overlap at one configuration, a motion for the requested clearance.
QUERY_VERDICTS = ("free", "collides")
MOTION_VERDICTS = ("clear", "too close")


@dataclass(frozen=True)
class Expected:
    """Expected result of a query or motion; None: not specified. If all are None, free or clear is expected.

    Attributes:
        verdict: one of `QUERY_VERDICTS` or `MOTION_VERDICTS`.
        distance: distance of the closest pair minus the padding, smallest over a motion, m; negative: penetration.
        pair: names of the closest two bodies.
    """

    verdict: str | None = None
    distance: float | None = None
    pair: Pair | None = None


@dataclass(frozen=True)
class Query:
    """One configuration.

    Attributes:
        name: name for messages.
        q: configuration (6,), rad.
        allowed: allowed collisions besides those of the scene.
        expected: expected result.
    """

    name: str
    q: Array
    allowed: frozenset[Pair]
    expected: Expected


@dataclass(frozen=True)
class Motion:
    """One straight joint motion.

    Attributes:
        name: name for messages.
        ends: first and last configuration, (2, 6), rad.
        asked: requested clearance, m.
        allowed: allowed collisions besides those of the scene.
        expected: expected result.
    """

    name: str
    ends: Array
    asked: float
    allowed: frozenset[Pair]
    expected: Expected


@dataclass(frozen=True, eq=False)
class SceneFile:
    """A scene with its queries and motions.

    Attributes:
        file: scene file.
        unit: controller whose joint limits apply.
        robot: arm with the jaws at `jaw_opening`.
        jaw_opening: distance between the fingers, m.
        bodies: fixed bodies, cubes included.
        held: body in the jaws, or None.
        T_tool_held: pose of the held body, 4x4; identity without one.
        allowed: allowed collisions (ACM) of all queries and motions.
        padding: subtracted from every distance, m.
        queries, motions: what to check.
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
        """Return the collision world, with further allowed collisions if given."""
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

    Keys: `unit`, `tool_length_mm`, `jaw_opening_mm`, `padding_mm`, `allowed` (pairs of names that may touch);
    `[[bodies]]` (see `cell.config.bodies`); `[[cubes]]`, and `[held]` for a cube in the jaws with its pose in the tool
    frame (`name`, `size_mm`, `centre_mm`, `rpy_deg`); `[[queries]]` (`name`, `q_deg`) and `[[motions]]` (`name`,
    `from_deg`, `to_deg`, `asked_mm`), each with an optional `allowed` and optional expected results: `verdict`,
    `distance_mm` or `clearance_mm`, `pair`. Without these, `free` or `clear` is expected. See `docs/scenes.md`.

    Raises:
        InputError: a value is wrong; names file, key, value, unit and rule.
    """
    root = TomlTable.read(path)
    if "task" in root or "q_start_deg" in root:
        kind = "task" if "task" in root else "cell"
        raise InputError(
            f"{path}: is a {kind} file; check needs a plan and its task (a465 check PLAN.json TASK.toml), a scene file "
            f"with queries or motions (docs/scenes.md), or a {kind} file with a configuration (--q)",
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
    """Read a cube. The pose of a held cube is in the tool frame."""
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
    """Return the joint limit that a configuration (6,), rad, violates, or ""."""
    for joint, (value, low, high) in enumerate(zip(q, unit.lower, unit.upper, strict=True), start=1):
        if not low <= value <= high:
            return f"J{joint} must be from {np.degrees(low):.1f} to {np.degrees(high):.1f} deg on {unit.name}"
    return ""


def read_surroundings(path: Path) -> SceneFile:
    """Read a scene file, or the cell of a cell or task file as a scene. Only looks place boards and cubes in a cell.

    Raises:
        InputError: the file is none of these, or is wrong.
    """
    root = TomlTable.read(path)
    if "task" in root:
        return _of_cell(read_task(path).cell)
    if "q_start_deg" in root or "camera" in root:
        return _of_cell(read_cell(path))
    return read_scene_file(path)


def _of_cell(cell: Cell) -> SceneFile:
    """Return the cell as a scene, jaws open."""
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
            key, f"names {unknown[0]!r}, which is not a body; must be of {', '.join(sorted(names))}"
        )
    return frozenset(value)
