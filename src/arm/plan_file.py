"""Plans, from the planner to preview and execution, and their files.

A plan is a chain of steps. Motion is stored as it will be sent: integer segments (`arm.controller.segments`).
Consecutive moves make one motion, from rest to rest, without stops between them. The file is canonical JSON, so the
same plan has the same bytes, and its SHA-256 identifies it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from arm.controller.segments import CountPath, Segment, chain
from arm.errors import FileInputError, InputError
from arm.io.json_fields import JsonFields
from arm.io.storage import canonical_json, read_json, require_finite, sha256, write_atomic
from arm.robot.shapes import body_from_json

FORMAT = "a465-plan/3"
_LETTERS = "23456789ABCDEFGHJKLMNPQRSTUVWXYZ"  # no two that look alike
ROUNDING = 1e-6  # m, by which a move's clearance may be below the smallest of its segments


@dataclass(frozen=True)
class Move:
    """A part of a motion in which the held body and the allowed collisions do not change.

    Attributes:
        name: such as "cube 1: approach 01-02/2".
        role: home, transit, approach or retract.
        cube: index of the task's cube that the move serves, or None.
        path: the segments that are sent.
        held: name of the body in the jaws, or None.
        jaw_opening: distance of the fingers during the move, m.
        clearance: smallest distance between any two checked bodies over the whole move, m; a proved lower bound if
            `certified`.
        closest: names of the two bodies at that distance.
        certified: whether `clearance` is proved between samples too.
        allowed_collisions: names of bodies that the held cube may touch: what it is lifted off, or placed on.
        clearances: proved lower bound on the clearance of every segment, m; the smallest is `clearance` up to rounding.
            May be empty if the move is not certified.
    """

    name: str
    role: str
    cube: int | None
    path: CountPath
    held: str | None
    jaw_opening: float
    clearance: float
    closest: tuple[str, str]
    certified: bool = False
    allowed_collisions: tuple[str, ...] = ()
    clearances: tuple[float, ...] = ()


@dataclass(frozen=True)
class GripperStep:
    """Open or close the jaws at rest. `fraction_closed` is the target, `settle_s` the shortest wait after it."""

    name: str
    action: str
    cube: int | None
    fraction_closed: float
    settle_s: float


@dataclass(frozen=True)
class LookStep:
    """Look again from rest; execution compares the result with the observation that the plan is based on."""

    name: str


Step = Move | GripperStep | LookStep


@dataclass(frozen=True)
class Motion:
    """Consecutive moves that are streamed as one: at rest at both ends only.

    Attributes:
        first: index of the first move among the steps.
        moves: in order.
    """

    first: int
    moves: tuple[Move, ...]

    @property
    def path(self) -> CountPath:
        """The segments of all moves.

        Raises:
            InputError: the moves do not meet to the count.
        """
        return chain([move.path for move in self.moves])

    @property
    def starts(self) -> tuple[int, ...]:
        """Index of the first segment of each move in the motion's path."""
        lengths = [len(move.path.segments) for move in self.moves]
        return tuple(sum(lengths[:i]) for i in range(len(lengths)))


def motions(steps: Sequence[Step]) -> tuple[Motion, ...]:
    """Return the runs of moves among steps, in order; any other step ends a run."""
    found: list[Motion] = []
    for index, step in enumerate(steps):
        if not isinstance(step, Move):
            continue
        last = found[-1] if found else None
        if last is not None and last.first + len(last.moves) == index:
            found[-1] = Motion(last.first, (*last.moves, step))
        else:
            found.append(Motion(index, (step,)))
    return tuple(found)


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
        """Sum of all motion, s."""
        return sum(move.path.duration_s for move in self.moves)

    def to_json(self) -> str:
        """Return the text of the file."""
        return canonical_json(_plan_to_json(self)) + "\n"

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
    value = read_json(path)
    if not isinstance(value, dict) or value.get("format") != FORMAT:
        found = value.get("format") if isinstance(value, dict) else None
        if isinstance(value, dict) and "scenes" in value:
            raise FileInputError(path, "scenes", None, "is from a look; a465 plan writes plan files")
        raise FileInputError(path, "format", found, f"must be {FORMAT!r}; plan again with this version")
    require_finite(path, value)
    return _PlanReader(path).plan(value)


def _plan_to_json(plan: Plan) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "task": plan.task,
        "unit": plan.unit,
        "speed": plan.speed,
        "speed_registers": list(plan.speed_registers),
        "acceleration_registers": list(plan.acceleration_registers),
        "steps": [_step_to_json(step) for step in plan.steps],
        "provenance": plan.provenance,
        "notes": plan.notes,
        "scene": plan.scene,
    }


def _step_to_json(step: Step) -> dict[str, Any]:
    match step:
        case Move():
            return {
                "step": "move",
                "name": step.name,
                "role": step.role,
                "cube": step.cube,
                "start_counts": list(step.path.start),
                "segments": [
                    [s.duration_ms, *(list(row) for row in s.coefficients)] for s in step.path.segments
                ],
                "held": step.held,
                "jaw_opening": step.jaw_opening,
                "clearance": step.clearance,
                "closest": list(step.closest),
                "certified": step.certified,
                "touching": list(step.allowed_collisions),
                "clearances": list(step.clearances),
            }
        case GripperStep():
            return {
                "step": "gripper",
                "name": step.name,
                "action": step.action,
                "cube": step.cube,
                "fraction_closed": step.fraction_closed,
                "settle_s": step.settle_s,
            }
        case LookStep():
            return {"step": "look", "name": step.name}


class _PlanReader(JsonFields):
    """Checks and builds a plan; every message names the key."""

    help = "plan again"

    def scene(self, value: dict[str, Any]) -> dict[str, Any]:
        """Return the scene as JSON types after a check of its bodies."""
        scene: dict[str, Any] = self.get(value, "scene", "", dict, "a table")
        for key in {"bodies", "cubes", "allowed"} & set(scene):
            if not isinstance(scene[key], list):
                raise self.fail(f"scene.{key}", scene[key], "must be a list")
        for index, pair in enumerate(scene.get("allowed", ())):
            if not isinstance(pair, list) or len(pair) != 2 or not all(isinstance(n, str) for n in pair):
                raise self.fail(f"scene.allowed[{index}]", pair, "must be the names of two bodies")
        for key in {"bodies", "cubes"} & set(scene):
            for index, body in enumerate(scene[key]):
                try:
                    body_from_json(body)
                except InputError as error:
                    raise self.fail(f"scene.{key}[{index}]", None, f"is not a body: {error}") from error
        return scene

    def task(self, value: dict[str, Any]) -> dict[str, Any]:
        """Return the task as JSON types after a check of its cubes."""
        task: dict[str, Any] = self.get(value, "task", "", dict, "a table")
        cubes = self.get(task, "cubes", "task.", list, "a list") if "cubes" in task else ()
        for index, cube in enumerate(cubes):
            for key in ("cube", "from", "to"):
                self.get(cube, key, f"task.cubes[{index}].", str, "a name")
        return task

    def plan(self, value: dict[str, Any]) -> Plan:
        steps = self.get(value, "steps", "", list, "a list of steps")
        plan = Plan(
            task=self.task(value),
            unit=self.get(value, "unit", "", str, "a unit's name"),
            speed=self.number(value, "speed", "", 1e-6, 1.0),
            speed_registers=self.integers(value.get("speed_registers"), "speed_registers"),
            acceleration_registers=self.integers(
                value.get("acceleration_registers"), "acceleration_registers"
            ),
            steps=tuple(self.step(step, f"steps[{i}].") for i, step in enumerate(steps)),
            provenance=self.get(value, "provenance", "", dict, "a table"),
            notes=self.get(value, "notes", "", dict, "a table"),
            scene=self.scene(value),
        )
        moves = list(plan.moves)
        if not moves:
            raise self.fail("steps", None, "have no move")
        for before, after in pairwise(moves):
            if before.path.end != after.path.start:
                raise self.fail(
                    "steps",
                    after.name,
                    f"starts at {after.path.start}, but {before.name!r} ends at {before.path.end}",
                )
        return plan

    def step(self, value: object, where: str) -> Step:
        kind = self.get(value, "step", where, str, "move, gripper or look")
        name = self.get(value, "name", where, str, "a text")
        match kind:
            case "look":
                return LookStep(name)
            case "gripper":
                return GripperStep(
                    name=name,
                    action=self.choice(value, "action", where, ("open", "close")),
                    cube=self.get(value, "cube", where, (int, type(None)), "a cube's index or null"),
                    fraction_closed=self.number(value, "fraction_closed", where, 0.0, 1.0),
                    settle_s=self.number(value, "settle_s", where, 0.0, 60.0),
                )
            case "move":
                return self.move(value, name, where)
        raise self.fail(where + "step", kind, "must be move, gripper or look")

    def move(self, value: object, name: str, where: str) -> Move:
        segments = []
        for i, row in enumerate(self.get(value, "segments", where, list, "a list of segments")):
            key = f"{where}segments[{i}]"
            if not isinstance(row, list) or not 2 <= len(row) <= 4:
                raise self.fail(key, row, "must be a duration in ms and 1 to 3 rows of coefficients")
            if not isinstance(row[0], int) or isinstance(row[0], bool) or not 0 <= row[0] <= 60_000:
                raise self.fail(key, row[0], "duration must be a whole number of ms from 0 to 60000")
            segments.append(Segment(row[0], tuple(self.integers(r, key) for r in row[1:])))
        if not segments:
            raise self.fail(where + "segments", [], "must be at least one segment")
        clearance = self.number(value, "clearance", where)
        touching = self.get(value, "touching", where, list, "body names")
        if not all(isinstance(n, str) for n in touching):
            raise self.fail(where + "touching", touching, "must be body names")
        closest = self.get(value, "closest", where, list, "two body names")
        if len(closest) != 2 or not all(isinstance(n, str) for n in closest):
            raise self.fail(where + "closest", closest, "must be two body names")
        certified = self.get(value, "certified", where, bool, "true or false")
        return Move(
            name=name,
            role=self.choice(value, "role", where, ("home", "transit", "approach", "retract")),
            cube=self.get(value, "cube", where, (int, type(None)), "a cube's index or null"),
            path=CountPath(
                self.integers(
                    self.get(value, "start_counts", where, list, "six counts"), where + "start_counts"
                ),
                tuple(segments),
            ),
            held=self.get(value, "held", where, (str, type(None)), "a body's name or null"),
            jaw_opening=self.number(value, "jaw_opening", where, 0.0, 1.0),
            clearance=clearance,
            closest=(closest[0], closest[1]),
            certified=certified,
            allowed_collisions=tuple(touching),
            clearances=self.clearances(value, where, clearance, len(segments), may_lack=not certified),
        )

    def clearances(
        self, value: object, where: str, clearance: float, count: int, may_lack: bool
    ) -> tuple[float, ...]:
        """Return one clearance per segment, the smallest that of the move; an uncertified move may lack them."""
        key = where + "clearances"
        found = self.get(value, "clearances", where, list, "numbers, one for each segment")
        if not all(isinstance(v, int | float) and not isinstance(v, bool) and abs(v) <= 1e9 for v in found):
            raise self.fail(key, found, "must be numbers in m, one for each segment")
        if len(found) != count and not (may_lack and not found):
            raise self.fail(key, len(found), f"must be as many as the move has segments, {count}")
        if found and not clearance <= min(found) <= clearance + ROUNDING:
            raise self.fail(
                key,
                min(found),
                f"the smallest must be the move's clearance, {clearance:g} m, up to rounding",
            )
        return tuple(float(v) for v in found)
