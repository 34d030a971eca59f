"""A path as a step of a program file: where its line comes from, how the tool is held, and what it may do."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import A465Error
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import flag, is_number, line, number, numbers, path, zero_or
from arm.numerics.products import norm
from arm.robot.shapes import Body
from arm.se3 import Array, frozen
from cell.config.bodies import PLACE
from cell.files.pose_list import RANGES
from cell.program.biarcs import rounded
from cell.program.frames import CHORD_ERROR, PathPoses, poses_along
from cell.program.outline import STRAIGHT, Arc, Outline, through
from cell.program.points import POINTS, read_wire
from cell.program.svg import TOLERANCE, strokes_of
from plan.kinematics.numeric_ik import FREE
from plan.motion.builder import OFF_LINE

ALONG = {"along": 1.0, "against": -1.0}
# m, by which the tool as it is sent may leave a rounded path: the builder's tolerance, chords, curves of a drawing
_OFF_PATH = OFF_LINE + CHORD_ERROR + TOLERANCE
_LEAST_DEVIATION, _MOST_DEVIATION = 2e-4, 0.05  # m
_TOUCH = 'pairs of names of bodies, such as [["ring", "foot"]]'
Pairs = frozenset[frozenset[str]]


def _axis(node: Node) -> str | Array:
    """Read along, against, or a direction in the frame of the workpiece."""
    words = f"{', '.join(ALONG)}, or a direction x, y, z in the frame of the workpiece"
    if isinstance(node.value, str) and node.value in ALONG:
        return node.value
    good = isinstance(node.value, list) and len(node.value) == 3 and all(map(is_number, node.value))
    direction = np.array(node.value if good else [0.0, 0.0, 0.0], dtype=float)
    if not (np.isfinite(direction).all() and 1e-6 < norm(direction) < 1e6):
        raise node.error(f"must be {words}")
    return frozen(direction / norm(direction))


def _pairs(node: Node) -> Pairs:
    found = set()
    listed = isinstance(node.value, list)
    if not listed or not all(isinstance(pair, list) for pair in node.value):
        two = listed and len(node.value) == 2 and all(isinstance(name, str) for name in node.value)
        meant = f'[["{node.value[0]}", "{node.value[1]}"]]' if two else ""
        raise node.error(f"must be {_TOUCH}", f"for one pair: {meant}" if two else "")
    for pair in node.items():
        names = [one.read(line()) for one in pair.items()]
        if len(names) != 2 or names[0] == names[1]:
            raise pair.error("must be the names of two bodies")
        found.add(frozenset(names))
    return frozenset(found)


def _names(node: Node) -> frozenset[str]:
    if isinstance(node.value, str):
        raise node.error("must be a list of names of bodies", f'for one: ["{node.value}"]')
    return frozenset(one.read(line()) for one in node.items())


def _free(node: Node) -> str:
    if isinstance(node.value, list) and all(isinstance(one, str) for one in node.value):
        rule = "must be a string with names of directions"
        raise node.error(rule, f'free = "{", ".join(node.value)}"')
    words = node.read(line())
    wrong = [name for name in words.replace(",", " ").split() if name not in FREE]
    if wrong:
        raise node.error(f"has {wrong[0]!r}; must be names of directions, of {', '.join(FREE)}")
    return words


def _deviation(node: Node) -> float:
    deviation = node.read(number("mm", 0.0, 1e3 * _MOST_DEVIATION))
    if 0.0 < deviation < _LEAST_DEVIATION:
        why = f"as the motion may be {1e3 * OFF_LINE:g} mm off its path"
        raise node.error(f"must be 0, or at least {1e3 * _LEAST_DEVIATION:g} mm, {why}")
    return deviation


_EXTEND = numbers(2, "mm", -5000.0, 5000.0)
_LEAST_EXTEND = 5e-4  # m


def _extend(node: Node) -> Array:
    found = node.read(_EXTEND)
    if 0.0 < np.abs(found).max() < _LEAST_EXTEND:
        raise node.error(
            f"must be [0, 0], or {1e3 * _LEAST_EXTEND:g} mm or more at an end", "is it in metres?"
        )
    return found


TOUCH = Rule(_TOUCH, _pairs)
DEVIATION = Rule(
    f"0, or a number in mm from {1e3 * _LEAST_DEVIATION:g} to {1e3 * _MOST_DEVIATION:g}", _deviation
)
FREE_RULE = Rule(f"names of directions, of {', '.join(FREE)}", _free)


class FreedomKeys(Keys):
    """Keys about what is free at a pose, or everywhere on a path; see `plan.program.goals.target.Target`."""

    free: str = key("free", FREE_RULE, "")
    tilt: float = key("tilt_deg", number("deg", 0.0, 90.0), 0)
    ranges: dict[str, tuple[float, float]] = key("ranges", RANGES, {})
    speed: float | None = key("speed_mm_s", number("mm/s", 0.1, 2000.0), None)
    touch: Pairs = key("touch", TOUCH, [])


_WIDTH = number("mm", 1.0, 5000.0)  # of a drawing
_LIFT = number("mm", 0.5, 200.0)  # of the arcs to its strokes


class PathKeys(FreedomKeys):
    """Keys of a path."""

    points: Outline | None = key("points_mm", POINTS, None)
    line_of: Path | None = key("line_of", path(), None)
    svg: Path | None = key("svg", path(), None)
    meander: Array | None = key("meander_mm", numbers(2, "mm", 1.0, 5000.0), None)
    pitch: float | None = key("pitch_mm", number("mm", 0.1, 1000.0), None)
    width: float | None = key("width_mm", _WIDTH, None)
    corner: Array = key("corner_mm", PLACE, [0, 0, 0])
    lift: float | None = key("lift_mm", _LIFT, None)
    backwards: bool = key("backwards", flag(), False)
    extend: Array = key("extend_mm", Rule(_EXTEND.words, _extend), [0, 0])
    deviation: float = key("deviation_mm", DEVIATION, 0)
    axis: Any = key("axis", Rule("along, against, or a direction x, y, z", _axis))
    window: float = key("window_mm", zero_or(0.5, 500.0), 25)
    turn: float = key("turn_deg", number("deg", -360.0, 360.0), 0)
    back: bool = key("back", flag(), False)
    steady: bool = key("steady", flag(), False)
    threaded: str | None = key("threaded", line(), None)
    clearance_of: frozenset[str] = key("clearance_of", Rule("names of bodies", _names), [])


SOURCES = ("points_mm", "line_of", "svg", "meander_mm")  # keys that make a step a path, each by itself
FILES = ("line_of", "svg")  # those of them that name a file
MOST_LINES = 500  # of a meander
_ON_PLANE = ("svg", "meander_mm")
_NEEDS = {  # what each of these keys is for
    "width_mm": ("svg",),
    "pitch_mm": ("meander_mm",),
    "corner_mm": _ON_PLANE,
    "lift_mm": _ON_PLANE,
    "threaded": ("line_of",),
    "backwards": ("points_mm", "line_of", "meander_mm"),
    "extend_mm": ("points_mm", "line_of"),
}


@dataclass(frozen=True, eq=False)
class ThreadedLine:
    """The line that passes through a ring of the tool; see `arm.robot.thread.Thread`.

    Attributes:
        name: of the line: that of its file.
        ring: name of the tool's body.
        points: (k, 3) m, of the line from its foot to its free end, in the frame of the workpiece.
        bodies: of the wire, with poses in the frame of the workpiece.
    """

    name: str
    ring: str
    points: Array
    bodies: tuple[Body, ...]


@dataclass(frozen=True, eq=False)
class PathStep:
    """A path of the tool.

    Attributes:
        key: position in the file, such as ``steps[2]``.
        name: unique name for messages.
        outline: of the tool's origin, in the frame of the workpiece, as it is travelled.
        poses: along it.
        free, tilt, ranges, speed, touch: see `FreedomKeys`.
        back: whether the tool returns along the same path.
        steady: whether the tool keeps one speed, at most `speed`.
        clearance_of: names of bodies whose clearance is maximised if that is the aim; all if empty.
        threaded: the line that stays in a ring of the tool; None for none.
        source: key of `SOURCES` that the step has.
        extended: by how much its start and its end are prolonged, m.
    """

    key: str
    name: str
    outline: Outline
    poses: PathPoses
    free: str
    tilt: float
    ranges: dict[str, tuple[float, float]]
    speed: float | None
    touch: Pairs
    back: bool
    steady: bool
    clearance_of: frozenset[str]
    threaded: ThreadedLine | None
    source: str
    extended: tuple[float, float]

    def legs(self) -> tuple[Array, ...]:
        """Return the poses (k, 4, 4) between the corners at which the arm stops, each with both its ends."""
        cuts = np.searchsorted(self.poses.s, self.poses.stops - STRAIGHT)
        ends = [0, *cuts.tolist(), len(self.poses.s) - 1]
        return tuple(self.poses.T_work_tool[a : b + 1] for a, b in pairwise(ends) if b > a)


def paths_of(node: Node, name: str, keys: PathKeys) -> Iterator[PathStep]:
    """Yield the path of a step with these keys, or those of the strokes of its drawing.

    Raises:
        InputError: the keys do not make a path; names file, key, value and rule.
    """
    drawn = keys.line_of is not None and keys.line_of.suffix.lower() == ".svg"
    for optional, sources in () if drawn else _NEEDS.items():
        if optional in node and not any(source in node for source in sources):
            raise node.error_at(optional, f"needs {' or '.join(sources)}")
    if "window_mm" in node and not isinstance(keys.axis, str):
        raise node.error_at("window_mm", "needs axis along or against: a fixed direction does not turn")
    if set(keys.free.replace(",", " ").split()) - {"rz"}:
        raise node.error_at("free", "must be rz, or nothing, on a path; give ranges for other directions")
    if keys.svg is not None:
        strokes = _drawn(node, keys.svg, keys)
        for number, stroke in enumerate(strokes, start=1):
            of = name if len(strokes) == 1 else f"{name}, stroke {number}"
            yield _path(node, of, keys, stroke, 1.0)
        return
    whole, bodies = keys.points, tuple[Body, ...]()
    if keys.meander is not None:
        whole = _meander(node, keys.meander).moved(keys.corner)
    if keys.line_of is not None:
        if keys.line_of.suffix.lower() == ".svg":
            raise node.error_at("line_of", "names a drawing, must name a wire file", "svg takes drawings")
        wire = read_wire(keys.line_of)
        whole, bodies = wire.outline, wire.bodies
        if whole is None:
            raise node.error_at("line_of", "names a file without line_mm")
    if whole is None:
        raise node.error(f"must have one of {', '.join(SOURCES)}")
    try:
        outline, along = _travelled(whole, keys)
        outline = outline if keys.lift is None else _with_lifts(outline, keys.lift)
    except A465Error as error:
        raise node.error(str(error)) from error
    threaded = None
    if keys.threaded is not None and keys.line_of is not None:
        points = whole.at(whole.sampled(CHORD_ERROR, whole.length))
        threaded = ThreadedLine(keys.line_of.stem, keys.threaded, frozen(points), bodies)
    yield _path(node, name, keys, outline, along, threaded)


def _path(
    node: Node,
    name: str,
    keys: PathKeys,
    outline: Outline,
    along: float,
    threaded: ThreadedLine | None = None,
) -> PathStep:
    fixed, sign = (None, ALONG[keys.axis]) if isinstance(keys.axis, str) else (keys.axis, 1.0)
    try:
        poses = poses_along(outline, fixed, sign * along, keys.window, keys.turn)
    except A465Error as error:
        raise node.error(str(error)) from error
    if keys.steady:
        _require_steady(node, keys, poses)
    values = {key: getattr(keys, key) for key in ("back", "steady", "clearance_of", *FreedomKeys.declared())}
    source = next(one for one in SOURCES if one in node)
    before, after = np.maximum(keys.extend, 0.0).tolist()
    return PathStep(
        node.key, name, outline, poses, **values, threaded=threaded, source=source, extended=(before, after)
    )


def _require_steady(node: Node, keys: PathKeys, poses: PathPoses) -> None:
    """Require what one speed on a path needs: a speed, a tool that does not turn with the path, and no stop on it."""
    if keys.speed is None:
        raise node.error_at("steady", "needs speed_mm_s")
    if isinstance(keys.axis, str):
        raise node.error_at(
            "steady", "needs a direction x, y, z as axis: a tool along its path turns with it"
        )
    if len(poses.stops):
        where = f"the arm stops at the corner {1e3 * poses.stops[0]:.0f} mm after the start"
        raise node.error_at("steady", f"needs a path without stops: {where}; round it by deviation_mm")


def _drawn(node: Node, file: Path, keys: PathKeys) -> list[Outline]:
    """Return the strokes of a drawing, each with an arc down to it and one up from it, both along its ends."""
    if isinstance(keys.axis, str):
        raise node.error_at("axis", "must be a direction x, y, z, with svg")
    width, lift = (node.get(name, rule) for name, rule in (("width_mm", _WIDTH), ("lift_mm", _LIFT)))
    return [
        _with_lifts(_rounded(stroke, keys.deviation).moved(keys.corner), lift)
        for stroke in strokes_of(file, width)
    ]


def _meander(node: Node, size: Array) -> Outline:
    """Return lines along x, there and back, over the rectangle from the origin to `size` (2,) m."""
    pitch = node.get("pitch_mm", number("mm", 0.1, 1000.0))
    lines = int(np.ceil(size[1] / pitch - 1e-9)) + 1
    if lines > MOST_LINES:
        raise node.error_at("pitch_mm", f"makes {lines} lines; must make at most {MOST_LINES}")
    ends = [
        (side * size[0], y, 0.0) for k, y in enumerate(np.linspace(0.0, size[1], lines)) for side in _sides(k)
    ]
    return through(ends)


def _sides(line: int) -> tuple[int, int]:
    return (0, 1) if line % 2 == 0 else (1, 0)


def _with_lifts(stroke: Outline, lift: float) -> Outline:
    up = frozen([0.0, 0.0, 1.0])
    last = stroke.pieces[-1]
    first, end = stroke.at([0.0, stroke.length])
    ahead, ahead_end = stroke.directions([0.0])[0], last.directions(np.array([last.length]))[0]
    down = Arc(frozen(first + lift * up), lift, frozen(-ahead), frozen(-up), np.pi / 2.0)
    rise = Arc(frozen(end + lift * up), lift, frozen(-up), frozen(ahead_end), np.pi / 2.0)
    return Outline((down, *stroke.pieces, rise))


def _rounded(outline: Outline, deviation: float) -> Outline:
    """Return the outline with corners so rounded that the tool as it is sent stays within `deviation`, m, of it."""
    return rounded(outline, deviation - _OFF_PATH) if deviation else outline


def _travelled(whole: Outline, keys: PathKeys) -> tuple[Outline, float]:
    """Return the outline as it is travelled, and 1, or -1 if that is against the line as it is stated."""
    smooth = _rounded(whole, keys.deviation)
    smooth = smooth.backwards() if keys.backwards else smooth
    before, after = keys.extend.tolist()
    return smooth.cut(-before, smooth.length + after), -1.0 if keys.backwards else 1.0
