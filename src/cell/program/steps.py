"""The steps of a program file: a path, a pose, joint angles, or an action at rest. The keys decide which."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from arm.io.keys import Keys, alike, key
from arm.io.node import Node, Rule
from arm.io.rules import carried, integers, line, number, numbers, text
from arm.numerics.products import mul
from arm.se3 import Array, frozen, transform
from cell.config.bodies import FARTHEST_MM, TURN, pose_of
from cell.files.pose_list import AWAY, JAWS_RULE, WAYS, WITHIN
from cell.program.path_step import SOURCES, FreedomKeys, Pairs, PathKeys, PathStep, paths_of

MOST_PLACES = 1000  # of a grid
LEAST_STEP = 1e-3  # of a grid, m
RESERVED = ("start", "end")  # names of where every plan of a program begins and ends
TAKE, PUT = "take", "put"  # what a step does with a part
_KINDS = (*SOURCES, "at_mm", "joints_deg")  # the key of each kind of step that moves


class ActionKeys(Keys):
    """Keys of what happens while the arm rests, after the step's motion if it has one."""

    name: str | None = key("name", line(), None)
    jaws: float | None = key("jaws", JAWS_RULE, None)
    dwell_s: float = key("dwell_s", number("s", 0.0, 60.0), 0)
    part: str | None = key("part", text(TAKE, PUT), None)


class PathStepKeys(PathKeys, ActionKeys):
    """Keys of a step that is a path."""


class PoseStepKeys(FreedomKeys, ActionKeys):
    """Keys of a step that is a pose."""

    at: Array = key("at_mm", carried(FARTHEST_MM))
    rpy: Array = key("rpy_deg", TURN, [180, 0, 0])
    by: str = key("by", line(*WAYS), "transit")
    approach: float = key("approach_mm", AWAY, 0)
    retract: float = key("retract_mm", AWAY, 0)
    within: float = key("within_mm", WITHIN, 0)
    count: tuple[int, ...] = key("grid.count", integers(3, 1, MOST_PLACES), [1, 1, 1])
    step: Array = key("grid.step_mm", numbers(3, "mm", -5000.0, 5000.0), [0, 0, 0])


class JointStepKeys(ActionKeys):
    """Keys of a step that is a configuration."""

    q: Array = key("joints_deg", numbers(6, "deg", -360, 360))


_ALSO = {  # what lists of poses, and other programs, call what a key of a step is
    **dict.fromkeys(("q_deg", "q_rad", "q"), "joints_deg"),
    **dict.fromkeys(("T_base_tool", "T_base_flange", "pose", "position_mm", "xyz_mm"), "at_mm, with rpy_deg"),
    **dict.fromkeys(("pause_s", "wait_s", "sleep_s", "delay_s"), "dwell_s"),
    **dict.fromkeys(("line_mm", "path_mm"), "points_mm"),
    "gripper": "jaws",
}
_KEYS_OF: dict[str, type[ActionKeys]] = {
    **dict.fromkeys(SOURCES, PathStepKeys),
    "at_mm": PoseStepKeys,
    "joints_deg": JointStepKeys,
}


@dataclass(frozen=True, eq=False)
class PoseStep:
    """A pose of the tool, or the places of a grid that are visited one after the other.

    Attributes:
        key, name: see `cell.program.path_step.PathStep`.
        T_work_tool: (k, 4, 4), one pose, or those of a grid, x first, then y, then z.
        by, approach, retract, within: see `plan.program.goals.target.Target`; within is its blend radius.
        free, tilt, ranges, speed, touch: see `FreedomKeys`.
        part: `TAKE` or `PUT` if a part is taken or put down there, else None; then rz may be free, and is for the turns
            at which the part is the same (`cell.program.parts.handled`).
    """

    key: str
    name: str
    T_work_tool: Array
    by: str
    approach: float
    retract: float
    within: float
    free: str
    tilt: float
    ranges: dict[str, tuple[float, float]]
    speed: float | None
    touch: Pairs
    part: str | None = None


@dataclass(frozen=True, eq=False)
class JointStep:
    """A configuration q (6,), rad; key and name as of a `PoseStep`."""

    key: str
    name: str
    q: Array


@dataclass(frozen=True)
class Action:
    """What happens at rest: jaws by their closed fraction, 0 open to 1 shut (None: unchanged); then a pause."""

    key: str
    name: str
    jaws: float | None
    dwell_s: float


Step = PathStep | PoseStep | JointStep | Action


def name_of(step: Step, repeat: int) -> str:
    """Return the name of a step in a repeat, from 0."""
    return step.name if repeat == 0 else f"{step.name} ({repeat + 1})"


def _read(node: Node) -> list[Step]:
    """Return what a table of ``[[steps]]`` asks for: a motion, an action, or both."""
    if not isinstance(node.value, dict):
        raise node.error("must be a table")
    given = [name for name in _KINDS if name in node]
    if len(given) > 1:
        raise node.error_at(given[1], f"cannot be combined with {given[0]}; a step has one of them")
    number = int(node.key.rpartition("[")[2].rstrip("]")) + 1
    found: list[Step] = []
    keys: ActionKeys
    _require_own_keys(node, given[0] if given else "")
    match given[0] if given else "":
        case "":
            keys = ActionKeys.read(node)
            if keys.jaws is None and keys.dwell_s == 0.0:
                raise node.error(f"must have one of {', '.join(_KINDS)}, or only jaws or dwell_s")
            name = keys.name or f"step {number}"
        case "at_mm":
            keys = PoseStepKeys.read(node)
            name = keys.name or f"pose {number}"
            found.append(_pose(node, name, keys))
        case "joints_deg":
            keys = JointStepKeys.read(node)
            name = keys.name or f"joints {number}"
            found.append(JointStep(node.key, name, keys.q))
        case _:
            keys = PathStepKeys.read(node)
            name = keys.name or f"path {number}"
            found += paths_of(node, name, keys)
    if keys.part is not None:
        _require_handles(node, keys)
    if keys.jaws is not None or keys.dwell_s > 0.0:
        found.append(Action(node.key, name, keys.jaws, keys.dwell_s))
    return found


def _require_own_keys(node: Node, kind: str) -> None:
    """Refuse keys of another kind of step; those that no step has are left to the keys of its own kind.

    Args:
        node: the step.
        kind: of `_KINDS`, which the step has; "" for none.
    """
    if not kind:
        every = sorted({name for keys in _KEYS_OF.values() for name in _tops(keys)})
        for name in (one for one in node.value if one not in every):
            near = [_ALSO[name]] if name in _ALSO else alike(name, every)
            help = (
                f"did you mean {near[0]}?"
                if near
                else f"a step has one of {', '.join(_KINDS)}, or jaws or dwell_s"
            )
            raise node.error_at(name, "is not a known key", help)
    own = PathStepKeys if kind in SOURCES else _KEYS_OF.get(kind, ActionKeys)
    for name in node.value:
        takes = [kind for kind, keys in _KEYS_OF.items() if name in _tops(keys)]
        if takes and name not in _tops(own):
            has = f"this one has {kind}" if kind else "this one has none"
            raise node.error_at(name, f"is a key of a step with {' or '.join(takes)}, and {has}")


def _tops(kind: type[Keys]) -> set[str]:
    """Return the keys of a step, and the names of its tables."""
    return {name.partition(".")[0] for name in kind.names()}


def _require_handles(node: Node, keys: ActionKeys) -> None:
    """Require what a step needs that takes a part or puts it down: a pose that is reached by a transit, and jaws."""
    if not isinstance(keys, PoseStepKeys):
        raise node.error_at("part", "needs at_mm: a part is taken and put down at a pose, by the jaws")
    does = "closes" if keys.part == TAKE else "opens"
    if keys.jaws is None or (keys.jaws > 0.0) != (keys.part == TAKE):
        raise node.error_at(
            "part", f"needs jaws = {does.removesuffix('s')!r}: a step that {keys.part}s {does} them"
        )
    if keys.by != "transit":
        raise node.error_at("by", "must be transit where a part is taken or put down; give approach_mm")
    if set(keys.free.replace(",", " ").split()) - {"rz"}:
        raise node.error_at("free", "may only be rz where a part is taken or put down, between its faces")
    for given, value in (("tilt_deg", keys.tilt), ("ranges", keys.ranges)):
        if value:
            raise node.error_at(given, "cannot be where a part is taken or put down: the jaws hold its faces")


def _pose(node: Node, name: str, keys: PoseStepKeys) -> PoseStep:
    count = int(np.prod(keys.count))
    sizes = np.abs(keys.step)
    if ((sizes > 0.0) & (sizes < LEAST_STEP)).any():
        rule = f"must be 0, or {1e3 * LEAST_STEP:g} mm or more, along each axis; the unit is mm: 50 mm is 50"
        raise node.error_at("grid.step_mm", rule)
    if count > MOST_PLACES:
        raise node.error_at("grid.count", f"makes {count} places; must be at most {MOST_PLACES}")
    if "grid" in node:
        for needed in ("count", "step_mm"):
            if needed not in node["grid"]:
                raise node.error_at(f"grid.{needed}", "is missing; a grid needs count and step_mm")
    shifts = [
        transform(t=keys.step * np.array([i, j, k])) for k, j, i in product(*map(range, keys.count[::-1]))
    ]
    T = pose_of(keys.at, keys.rpy)
    of_pose = ("by", "approach", "retract", "within", "part", *FreedomKeys.declared())
    values = {name: getattr(keys, name) for name in of_pose}
    return PoseStep(node.key, name, frozen([mul(shift, T) for shift in shifts]), **values)


def _steps(node: Node) -> tuple[Step, ...]:
    steps = [step for one in node.items() for step in _read(one)]
    if not steps:
        raise node.error("must have at least one step")
    taken: dict[str, str] = {}
    for step in steps:
        if step.name in RESERVED:
            raise Node(node.file, f"{step.key}.name", step.name).error(
                "is the name of a place that every program has; choose another"
            )
        before = taken.setdefault(step.name, step.key)
        if before != step.key:
            raise Node(node.file, f"{step.key}.name", step.name).error(
                f"is also the name of {before}; names must differ"
            )
    return tuple(steps)


STEPS = Rule("an array of tables", _steps, (PathStepKeys, PoseStepKeys, JointStepKeys))
"""Rule of the steps of a program."""
