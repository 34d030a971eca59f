"""Plans, from the planner to preview and execution, and their files.

A plan is a chain of steps. Motion is stored as it will be sent: integer segments (`arm.controller.segments`).
Consecutive moves make one motion, from rest to rest, without stops between them. The file is canonical JSON, so the
same plan has the same bytes, and its SHA-256 identifies it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

from arm.controller.segments import CountPath, Segment
from arm.errors import FileInputError, InputError
from arm.io.kind import read_kind
from arm.io.node import Node, Rule
from arm.io.rules import flag, integer, is_number, is_whole, number, rule_of, same, table, text
from arm.io.storage import canonical_json, read_json, require_finite, sha256, write_atomic
from arm.plan_steps import (
    GripperStep,
    LookStep,
    Motion,
    Move,
    Pause,
    Step,
    duration_of,
    motions,
    touching_pairs,
)
from arm.robot.shapes import body_from_json

__all__ = [
    "FORMAT", "GripperStep", "LookStep", "Motion", "Move", "Pause", "Plan", "Step", "duration_of", "motions",
    "read_plan", "touching_pairs", "write_plan",
]  # fmt: skip

FORMAT = "a465-plan/3"
_LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # no two that look alike
ROUNDING = 1e-6  # m, by which a move's clearance may be below the smallest of its segments' clearances


@dataclass(frozen=True)
class Plan:
    """Plan of a whole task, for preview and execution.

    Attributes:
        task: name and kind of the task, and the transfers of the cubes (JSON types).
        unit: name of the unit.
        speed: speed factor of the time parametrisation, 0 < speed <= 1.
        speed_registers, acceleration_registers: registers that the controller must have during execution.
        steps: in order.
        provenance: inputs of the plan: hashes of robot, scene, limits and calibration, options, seed, contents of
            files. All of it is compared before execution.
        scene: bodies and allowed contacts that the motion was checked against (JSON types), for preview and
            for independent checks.
        notes: versions and the like, for information only; the plan's code covers them.
        arm: the arm itself, if it has no unit (`plan.program.stated_arm`, JSON types), or empty.
    """

    task: dict[str, Any]
    unit: str
    speed: float
    speed_registers: tuple[int, ...]
    acceleration_registers: tuple[int, ...]
    steps: tuple[Step, ...]
    provenance: dict[str, Any]
    scene: dict[str, Any] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)
    arm: dict[str, Any] = field(default_factory=dict)

    @property
    def moves(self) -> Iterator[Move]:
        """All moves, in order."""
        return (step for step in self.steps if isinstance(step, Move))

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All motions, in order."""
        return motions(self.steps)

    @property
    def start(self) -> tuple[int, ...]:
        """Counts at the start of the first move."""
        return next(self.moves).path.start

    @property
    def duration_s(self) -> float:
        """Total duration of all moves, s."""
        return sum(move.path.duration_s for move in self.moves)

    def to_json(self) -> str:
        """Return the text of the file."""
        steps = [_step_to_json(step) for step in self.steps]
        stated = {key: value for key, value in vars(self).items() if key != "arm" or value}
        return canonical_json({**stated, "format": FORMAT, "steps": steps}) + "\n"

    @property
    def sha256(self) -> str:
        """Hash of the text of the file."""
        return sha256(self.to_json())

    @property
    def code(self) -> str:
        """Eight characters, such as ``7KQM-2XVD``, that only a preview of the plan shows.

        Execution on a real arm requires them, as evidence that the user has seen the preview.
        """
        number = int(sha256(f"seen {self.sha256}"), 16)
        letters = "".join(_LETTERS[(number >> 5 * place) % 32] for place in range(8))
        return f"{letters[:4]}-{letters[4:]}"


def write_plan(path: Path, plan: Plan) -> None:
    """Write a plan whole or not at all."""
    write_atomic(path, plan.to_json())


def read_plan(path: Path) -> Plan:
    """Read a plan file.

    Raises:
        FileInputError: not a plan, of another format version, or a value breaks a rule (named by its key).
    """
    value = read_kind(path, read_json, "plan")
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        found = value.get("format") if isinstance(value, dict) else None
        raise FileInputError(path, "format", found, f"must be {FORMAT!r}; plan again with this version")
    require_finite(path, value)
    return _plan(Node(path, "", value, "plan again"))


_KINDS = {GripperStep: "gripper", LookStep: "look", Pause: "pause"}  # of steps besides moves


def _step_to_json(step: Step) -> dict[str, Any]:
    if not isinstance(step, Move):
        left_out = ("cube",) if isinstance(step, LookStep) and step.cube is None else ()
        return {"step": _KINDS[type(step)]} | {k: v for k, v in vars(step).items() if k not in left_out}
    left_out = (
        "path",
        "allowed_collisions",
        "allowed_pairs",
        *(("threaded",) if step.threaded is None else ()),
    )
    kept = {k: v for k, v in vars(step).items() if k not in left_out}
    if step.allowed_pairs:
        kept["pairs"] = step.allowed_pairs
    return kept | {
        "step": "move",
        "start_counts": step.path.start,
        "segments": [[s.duration_ms, *s.coefficients] for s in step.path.segments],
        "touching": step.allowed_collisions,
    }


@cache
def _whole_numbers(count: int | None) -> Rule[tuple[int, ...]]:
    """Return the rule for one count of a controller per axis; None: for any number of axes."""
    return rule_of(
        f"{count or 'some'} whole numbers that fit the controller's 32-bit integers",
        lambda v: (
            isinstance(v, list)
            and len(v) == (count or max(len(v), 1))
            and all(is_whole(one, 1 - 2**31) for one in v)
        ),
        tuple,
    )


_CUBE = rule_of("a cube's index or null", lambda v: v is None or is_whole(v, -(2**63), 2**63), same)
_HELD = rule_of("a body's name or null", lambda v: v is None or isinstance(v, str), same)
_CLEARANCES = rule_of(
    "numbers in m, one for each segment",
    lambda v: isinstance(v, list) and all(is_number(one) and abs(one) <= 1e9 for one in v),
    lambda v: tuple(map(float, v)),
)
_NAMES = rule_of("body names", lambda v: isinstance(v, list) and all(isinstance(n, str) for n in v), tuple)
_TWO = rule_of(
    "the names of two bodies",
    lambda v: isinstance(v, list) and len(v) == 2 and all(isinstance(n, str) for n in v),
    tuple[str, str],
)


def _plan(root: Node) -> Plan:
    """Check and build a plan; every message names the key."""
    speed_registers = root.get("speed_registers", _whole_numbers(None))
    counts = _whole_numbers(len(speed_registers))
    plan = Plan(
        task=_task(root),
        unit=root.get("unit", text()),
        speed=root.get("speed", number("", 1e-6, 1.0)),
        speed_registers=speed_registers,
        acceleration_registers=root.get("acceleration_registers", counts),
        steps=tuple(_step(step, counts) for step in root["steps"].items()),
        provenance=root.get("provenance", table()),
        notes=root.get("notes", table()),
        scene=_scene(root),
        arm=root.get("arm", table(), {}),
    )
    moves = list(plan.moves)
    if not moves:
        raise root["steps"].error("must contain a move")
    for before, after in pairwise(moves):
        if before.path.end != after.path.start:
            rule = f"starts at {after.path.start}, but {before.name!r} ends at {before.path.end}"
            raise replace(root["steps"], value=after.name).error(rule)
    return plan


def _scene(root: Node) -> dict[str, Any]:
    """Return the scene as JSON types after a check of its bodies."""
    scene, values = root["scene"], root.get("scene", table())
    for pair in scene["allowed"].items() if "allowed" in scene else ():
        pair.read(_TWO)
    for body in (body for key in ("bodies", "cubes") if key in scene for body in scene[key].items()):
        try:
            body_from_json(body.value)
        except InputError as error:
            raise body.error(f"is not a body: {error}") from error
    return values


def _task(root: Node) -> dict[str, Any]:
    """Return the task as JSON types after a check of its cubes and of what was done before."""
    task, values = root["task"], root.get("task", table())
    for cube in task["cubes"].items() if "cubes" in task else ():
        for key in ("cube", "from", "to"):
            cube.get(key, text())
    for key in ("threaded_before", "parts_before"):
        task.get(key, integer(0, 2**31 - 1), 0)
    return values


def _step(node: Node, counts: Rule[tuple[int, ...]]) -> Step:
    kind, name = node.get("step", text()), node.get("name", text())
    match kind:
        case "look":
            return LookStep(name, node.get("cube", _CUBE) if "cube" in node else None)
        case "pause":
            return Pause(
                name,
                node.get("dwell_s", number("", 0.0, 3600.0)),
                node.get("attached", _HELD),
                node.get("detached", _HELD),
            )
        case "gripper":
            return GripperStep(
                name=name,
                action=node.get("action", text("open", "close")),
                cube=node.get("cube", _CUBE),
                fraction_closed=node.get("fraction_closed", number("", 0.0, 1.0)),
                settle_s=node.get("settle_s", number("", 0.0, 60.0)),
            )
        case "move":
            return _move(node, name, counts)
    raise node["step"].error("must be move, gripper, look or pause")


def _segment(node: Node, counts: Rule[tuple[int, ...]]) -> Segment:
    row = node.value
    if not isinstance(row, list) or not 2 <= len(row) <= 4:
        raise node.error("must be a duration in ms and 1 to 3 rows of coefficients")
    if not is_whole(row[0], 0, 60_000):
        raise replace(node, value=row[0]).error("duration must be a whole number of ms from 0 to 60000")
    return Segment(row[0], tuple(replace(node, value=r).read(counts) for r in row[1:]))


def _move(node: Node, name: str, counts: Rule[tuple[int, ...]]) -> Move:
    segments = tuple(_segment(row, counts) for row in node["segments"].items())
    if not segments:
        raise node["segments"].error("must be at least one segment")
    clearance, certified = node.get("clearance", number()), node.get("certified", flag())
    return Move(
        name=name,
        role=node.get("role", text("home", "transit", "approach", "line", "retract")),
        cube=node.get("cube", _CUBE),
        path=CountPath(node.get("start_counts", counts), segments),
        held=node.get("held", _HELD),
        jaw_opening=node.get("jaw_opening", number("", 0.0, 1.0)),
        clearance=clearance,
        closest=node.get("closest", _TWO),
        certified=certified,
        allowed_collisions=node.get("touching", _NAMES),
        allowed_pairs=tuple(pair.read(_TWO) for pair in node["pairs"].items()) if "pairs" in node else (),
        threaded=node.get("threaded", text()) if "threaded" in node else None,
        clearances=_clearances(node, clearance, len(segments), may_lack=not certified),
    )


def _clearances(move: Node, clearance: float, count: int, may_lack: bool) -> tuple[float, ...]:
    """Return one clearance per segment, the smallest equal to the move's; an uncertified move may lack them."""
    node = move["clearances"]
    found = node.read(_CLEARANCES)
    if len(found) != count and not (may_lack and not found):
        rule = f"must be the move's number of segments, {count}"
        raise replace(node, value=len(found)).error(rule)
    if found and not clearance <= min(found) <= clearance + ROUNDING:
        rule = f"the smallest must be the move's clearance, {clearance:g} m, up to rounding"
        raise replace(node, value=min(found)).error(rule)
    return found
