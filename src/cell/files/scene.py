"""The scene file (TOML): an arm among bodies, with queries and motions and their expected results.

Scene files test the collision checker, and measure distances without a plan.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.controller.unit import Unit, unit_rule
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.kind import kind_of
from arm.io.node import Node, Rule
from arm.io.rules import number, numbers, rule_of, tables, text, zero_or
from arm.robot.model import Robot, load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from cell.config.arm_file import ARM
from cell.config.bodies import ON_FLANGE, PLACE, PLACES, TURN, pose_of, read_body
from cell.config.cell import Cell
from cell.files.task import cell_of
from plan.collision.world import World

Pair = frozenset[str]
# A query tests for overlap at one configuration, a motion for the requested clearance.
QUERY_VERDICTS = ("free", "collides")
MOTION_VERDICTS = ("clear", "too close")
_PAIRS = rule_of("a list of pairs of names", lambda v: isinstance(v, list), list)
_DISTANCE = number("mm", -1000, 10000)
_LEAST_MM = 0.1  # of a clearance or padding; less is a length in m
_JOINTS = numbers(6, "deg", -360, 360)


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
    """One configuration, or one straight joint motion.

    Attributes:
        name: name for messages.
        q: the configuration (1, 6), or the first and the last one of a motion (2, 6), rad.
        allowed: allowed collisions besides those of the scene.
        expected: expected result.
        asked: requested clearance of a motion, m.
    """

    name: str
    q: Array
    allowed: frozenset[Pair]
    expected: Expected
    asked: float = 0.0


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
    motions: tuple[Query, ...]

    def world(self, allowed: Iterable[Pair] = ()) -> World:
        """Return the collision world, with further allowed collisions if given."""
        both = self.allowed | frozenset(allowed)
        return World(self.robot, self.bodies, self.held, self.T_tool_held, both, self.padding)


class _CubeKeys(Keys):
    name: str = key("name", text())
    size: float = key("size_mm", number("mm", 5, 80), 40)
    place: Array = key("centre_mm", PLACE)
    rpy: Array = key("rpy_deg", TURN, [0, 0, 0])


def _cube(node: Node) -> Body:
    """Read a cube. The pose of a held cube is in the tool frame."""
    keys = _CubeKeys.read(node)
    node.get("centre_mm", ON_FLANGE if node.key == "held" else PLACES["wall"])  # in metres it is told
    return Body(keys.name, Box((keys.size,) * 3), pose_of(keys.place, keys.rpy), "cube")


class _ExpectedKeys(Keys):
    name: str = key("name", text())
    allowed: list[Any] = key("allowed", _PAIRS, [])
    pair: Any = key("pair", Rule("two names", lambda node: node.value), None)


def _query_keys(node: Node) -> tuple[Node, _QueryKeys]:
    if "clearance_mm" in node:
        raise node.error_at("clearance_mm", "is not a known key of a query", "its distance is distance_mm")
    return node, _QueryKeys.read(node)


class _QueryKeys(_ExpectedKeys):
    q: Array = key("q_deg", _JOINTS)
    verdict: str | None = key("verdict", text(*QUERY_VERDICTS), None)
    distance: float | None = key("distance_mm", _DISTANCE, None)


class _MotionKeys(_ExpectedKeys):
    first: Array = key("from_deg", _JOINTS)
    last: Array = key("to_deg", _JOINTS)
    asked: float = key("asked_mm", zero_or(_LEAST_MM, 1000))
    verdict: str | None = key("verdict", text(*MOTION_VERDICTS), None)
    distance: float | None = key("clearance_mm", _DISTANCE, None)


class _SceneKeys(Keys):
    unit: Unit = key("unit", unit_rule())
    tool_length: float = key("tool_length_mm", number("mm", 1, 1000))
    jaw_opening: float = key("jaw_opening_mm", number("mm", 1, 100))
    padding: float = key("padding_mm", zero_or(_LEAST_MM, 100), 0)
    allowed: list[Any] = key("allowed", _PAIRS, [])
    bodies: tuple[Body, ...] = key("bodies", tables(lambda node: read_body(node, "wall")), [])
    cubes: tuple[Body, ...] = key("cubes", tables(_cube), [])
    held: Body | None = key("held", Rule("a table", _cube), None)
    queries: tuple[tuple[Node, _QueryKeys], ...] = key("queries", tables(_query_keys), [])
    motions: tuple[tuple[Node, _MotionKeys], ...] = key(
        "motions", tables(lambda node: (node, _MotionKeys.read(node))), []
    )


def read_scene_file(path: Path) -> SceneFile:
    """Read a scene file.

    The keys and their meaning are in docs/scenes.md. Without expected results, `free` or `clear` is expected.

    Raises:
        InputError: a value is wrong; names file, key, value, unit and rule.
    """
    root = Node.of_toml(path)
    if ARM in root:
        why = f"{path}: is an arm file; check needs a plan made with it (a465 check PLAN.json {path})"
        raise InputError(why, file=str(path))
    if kind_of(root.value) != "study" and ("task" in root or "q_start_deg" in root):
        kind = "task" if "task" in root else "cell"
        raise InputError(
            f"{path}: is a {kind} file; check needs a plan and its task (a465 check PLAN.json TASK.toml), a scene file "
            f"with queries or motions (docs/scenes.md), or a {kind} file with a configuration (--q)",
            file=str(path),
        )
    root.require_kind("scene")
    if "walls" in root:
        raise root.error_at("walls", "is not a known key of a scene file", "its bodies are [[bodies]]")
    keys = _SceneKeys.read(root)
    unit = keys.unit
    robot = load_a465(keys.tool_length, keys.jaw_opening)
    nodes = [node for key in ("bodies", "cubes") if key in root for node in root[key].items()]
    bodies = (*keys.bodies, *keys.cubes)
    nodes += [root["held"]] if keys.held else []
    names = {b.name for b in robot.bodies}
    for node, body in zip(nodes, (*bodies, keys.held) if keys.held else bodies, strict=True):
        if body.name in names:
            raise node.error_at("name", "is used twice, or is a body of the arm; names must differ")
        names.add(body.name)
    return SceneFile(
        file=path,
        unit=unit,
        robot=robot,
        jaw_opening=keys.jaw_opening,
        bodies=bodies,
        held=keys.held,
        T_tool_held=keys.held.T_base_body if keys.held else transform(),
        allowed=_allowed(root, keys.allowed, names),
        padding=keys.padding,
        queries=tuple(_query(*one, unit, names) for one in keys.queries),
        motions=tuple(_query(*one, unit, names) for one in keys.motions),
    )


def _query(node: Node, keys: _QueryKeys | _MotionKeys, unit: Unit, names: set[str]) -> Query:
    q = {"q_deg": keys.q} if isinstance(keys, _QueryKeys) else {"from_deg": keys.first, "to_deg": keys.last}
    for name, configuration in q.items():
        if rule := unit.beyond_limits(configuration):
            raise node.error_at(name, rule)
    pair = None if keys.pair is None else _pair(node, "pair", keys.pair, names)
    expected = Expected(keys.verdict, keys.distance, pair)
    asked = keys.asked if isinstance(keys, _MotionKeys) else 0.0
    return Query(keys.name, frozen([*q.values()]), _allowed(node, keys.allowed, names), expected, asked)


def read_surroundings(path: Path) -> SceneFile:
    """Read a scene file, or the cell of a cell or task file as a scene. Only looks place boards and cubes in a cell.

    Raises:
        InputError: the file is none of these, or is wrong.
    """
    root = Node.of_toml(path)
    if "task" in root or "q_start_deg" in root or "camera" in root:
        return _of_cell(cell_of(path))
    root.require_kind("scene", "cell", "task", "arm")
    return read_scene_file(path)


def _of_cell(cell: Cell) -> SceneFile:
    """Return the cell as a scene, jaws open."""
    none: frozenset[Pair] = frozenset()
    return SceneFile(
        cell.file,
        cell.unit,
        cell.robot(),
        cell.jaw_opening,
        cell.fixed,
        None,
        transform(),
        none,
        0.0,
        (),
        (),
    )


def _allowed(node: Node, pairs: list[Any], names: set[str]) -> frozenset[Pair]:
    return frozenset(_pair(node, "allowed", pair, names) for pair in pairs)


def _pair(node: Node, key: str, value: object, names: set[str]) -> Pair:
    if key == "allowed" and isinstance(value, str):
        raise node.error_at(key, "must name two different bodies", f'pairs are lists: [["{value}", "table"]]')
    if not isinstance(value, list) or not all(isinstance(n, str) for n in value) or len(set(value)) != 2:
        raise node.error_at(key, "must name two different bodies", 'such as ["finger_l", "table"]')
    unknown = sorted(set(value) - names)
    if unknown:
        known = ", ".join(sorted(names))
        raise node.error_at(key, f"names {unknown[0]!r}, which is not a body; must be of {known}")
    return frozenset(value)
