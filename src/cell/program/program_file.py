"""The program file (TOML): a workpiece, what stands on it, and the steps of the tool there."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np

from arm.board import Board
from arm.errors import InputError
from arm.io.keys import Keys, key
from arm.io.kind import kind_of, kind_of_file
from arm.io.node import Node, Rule
from arm.io.rules import carried, integer, integers, line, number, numbers, path, text, triple
from arm.io.storage import canonical_json, read_bytes, sha256
from arm.numerics.products import mul
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, inverse
from cell.config.arm_file import ARM, ArmFile
from cell.config.bodies import PLACE, TURN, pose_of, read_body
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.config.doubts.angles import doubt_of_deg
from cell.config.inputs import config_inputs
from cell.files.scene import read_scene_file
from cell.files.scene_doubts import scene_doubts
from cell.files.task import NOTHING, Task, board_of, place_or_arm, read_place, require_aim, task_or_cell
from cell.program.parts.handled import Part, parts_of
from cell.program.path_step import FILES, Pairs, PathStep, ThreadedLine
from cell.program.points import WORK, read_wire
from cell.program.steps import PUT, STEPS, TAKE, Action, JointStep, PoseStep, Step
from cell.program.threads import require_threads_provable
from plan.collision.covers import hull
from plan.options import AIMS

PROGRAM = "program"  # key that only a program file has, and the kind of its task
MOST_REPEATS = 1000
_THIN_PART = 0.006  # m between the jaws; what is thinner is rather in cm
_SEEN = ("plate ", "stand ", "cube ")  # how names of bodies begin that only a look knows


class ProgramValues(Keys):
    """Values of a program file that are used unchanged."""

    title: str = key(PROGRAM, line())
    aim: str = key("aim", text(*AIMS), "time")
    clearance_worth: float | None = key("clearance_worth_s_per_mm", number("s/mm", 0.001, 10000.0), None)
    clearance: float | None = key("clearance_mm", number("mm", 0, 100), None)
    end: Array | None = key("end_deg", numbers(6, "deg", -360, 360), None)
    seed: int = key("seed", integer(0, 2**31 - 1), 0)


def _bodies(node: Node) -> tuple[Body, ...]:
    """Read bodies, and files with bodies, of the workpiece."""
    found: list[Body] = []
    for one in node.items():
        if "file" in one:
            file = _FileKeys.read(one).file
            found += read_wire(file).bodies
        else:
            found.append(read_body(one, WORK))
        names = [body.name for body in found]
        if seen := [name for name in names if name.startswith(_SEEN)]:
            raise one.error(
                f"has a body {seen[0]!r}; names that begin with plate, stand or cube are of what a look finds"
            )
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise one.error(f"has the body {twice[0]!r} a second time; names of bodies must differ")
    return tuple(found)


class _FileKeys(Keys):
    file: Path = key("file", path())


class ProgramKeys(ProgramValues, file="a program"):
    """Keys of a program file."""

    cell: Path = key("cell", path())
    repeat: int | None = key("repeat", integer(1, MOST_REPEATS), None)
    board: tuple[int, ...] | None = key("work.board", integers(2, 0, 999), None)
    origin: Array = key("work.origin_mm", PLACE, [0, 0, 0])
    rpy: Array = key("work.rpy_deg", TURN, [0, 0, 0])
    box: tuple[float, float, float] | None = key("part.box_mm", triple("mm", 1, 2000), None)
    held_at: Array = key("part.at_mm", carried(2000), [0, 0, 0])
    part_name: str = key("part.name", line(), "part")
    bodies: tuple[Body, ...] = key("bodies", Rule("an array of tables", _bodies), [])
    steps: tuple[Step, ...] = key("steps", STEPS)


class ProgramTask(Task, ProgramValues):
    """A program of a cell.

    Attributes:
        steps: in order, at least one.
        repeat: how often they are taken; in each repeat a pose with a grid goes to its next place.
        board: the board on which the workpiece is, seen by its markers; None: the workpiece is where the file says.
        T_on_work: the frame of the workpiece in that of the board, or in the base frame.
        part: what is taken and put down, or None.
        bodies: on the workpiece, with poses in its frame.
    """

    steps: tuple[Step, ...]
    repeat: int
    board: Board | None
    T_on_work: Array
    part: Part | None
    bodies: tuple[Body, ...]

    @property
    def boards(self) -> tuple[Board, ...]:
        """Boards that a look must detect."""
        return () if self.board is None else (self.board,)

    @property
    def required(self) -> float:
        """Clearance of every motion, m."""
        return self.cell.clearance if self.clearance is None else self.clearance

    @property
    def q_end(self) -> Array:
        """Configuration at the end, (6,) rad."""
        return self.cell.q_start if self.end is None else self.end

    def doubts(self) -> tuple[str, ...]:
        """Say which values of cell and program may be in another unit.

        These are those of the cell, end_deg and joint angles of steps in rad, and a part's box in cm.
        """
        given = {} if self.end is None else {"end_deg": self.end}
        given |= {f"{step.key}.joints_deg": step.q for step in self.steps if isinstance(step, JointStep)}
        doubts = {key: doubt_of_deg(q, self.cell.unit) for key, q in given.items()}
        own = [f"{self.file.name}: {key} = {doubt}" for key, doubt in doubts.items() if doubt]
        if self.part is not None and self.part.size[1] < _THIN_PART:
            stated, meant = (", ".join(f"{unit * v:.6g}" for v in self.part.size) for unit in (1e3, 1e4))
            own.append(
                f"{self.file.name}: part.box_mm = [{stated}]: is it in cm? Then it must be [{meant}] in mm"
            )
        return (*super().doubts(), *own)

    @property
    def touch(self) -> Pairs:
        """Pairs of bodies that may touch in some step."""
        return frozenset[frozenset[str]]().union(
            *(s.touch for s in self.steps if isinstance(s, PathStep | PoseStep))
        )

    @property
    def threads(self) -> tuple[ThreadedLine, ...]:
        """Each line once that a ring is threaded on in some step."""
        threaded = (s.threaded for s in self.steps if isinstance(s, PathStep))
        return tuple({line.name: line for line in threaded if line is not None}.values())

    @cached_property
    def on_board(self) -> Array:
        """Corners of boxes around the bodies and parts on the board, in its frame, (k, 3) m."""
        if self.board is None:
            return NOTHING
        on_it = [(body.shape, body.T_base_body) for body in self.bodies_at(self.T_on_work)]
        if self.part is not None:
            handled = parts_of(self.part, self.steps, self.repeat, self.T_on_work).handled
            on_it += [(Box(self.part.size), one.T_base_part) for one in handled]
        around = [NOTHING]
        for shape, T_board_body in on_it:
            points, radius = hull(shape)
            low, high = points.min(axis=0) - radius, points.max(axis=0) + radius
            around.append(apply(T_board_body, list(product(*zip(low, high, strict=True)))))
        return frozen(np.concatenate(around))

    def bodies_at(self, T_base_work: Array) -> tuple[Body, ...]:
        """Return the bodies on the workpiece, in the base frame."""
        return tuple(body.at(mul(T_base_work, body.T_base_body)) for body in self.bodies)


def is_program(path: Path) -> bool:
    """Whether a TOML file is a program file.

    Raises:
        InputError: it cannot be read.
    """
    return is_program_file(task_or_cell(path))


def is_program_file(root: Node) -> bool:
    """Whether the content of a file is a program's, perhaps without its key `program`."""
    mine = PROGRAM in root or "steps" in root
    return kind_of(root.value) == PROGRAM or (mine and "from_board" not in root)


def is_of_poses(path: Path) -> bool:
    """Whether a TOML file is a cell or arm file, for which poses are planned: no task and no program.

    Raises:
        InputError: it cannot be read.
    """
    root = task_or_cell(path)
    return ("unit" in root or ARM in root) and "task" not in root and PROGRAM not in root


def place_of_file(path: Path) -> Task | ArmFile:
    """Read a program file, or what `cell.files.task.place_or_arm` reads.

    Raises:
        InputError: the file is none of them, or is wrong.
    """
    return read_program(path) if is_program(path) else place_or_arm(path)


def task_of_file(path: Path) -> Task:
    """Read a program file, a task file, or a cell file as a task without boards.

    Raises:
        InputError: the file is none of them, or is wrong.
    """
    return read_program(path) if is_program(path) else read_place(path)


def read_program(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> ProgramTask:
    """Read a program file and the cell file that it names.

    Args:
        path: the file.
        on_uncalibrated: see `cell.config.cell_file.read_cell`.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = task_or_cell(path)
    keys = ProgramKeys.read(root)
    cell = read_cell(keys.cell, on_uncalibrated)
    _check_cell(keys, root, cell)
    _check_parts(keys, root)
    inputs = {**config_inputs(root.value, left_out=("cell",)), **_files(root)}
    values = keys.values_of(ProgramValues)
    return ProgramTask(
        **values,
        file=path,
        kind=PROGRAM,
        cell=cell,
        from_board=cell.boards[0],  # of tasks of cubes; unused here
        look_after="never",
        order="given",
        assignment="given",
        skip=False,
        inputs=inputs,
        digest=sha256(sha256(canonical_json(inputs)) + cell.digest),
        steps=keys.steps,
        repeat=_repeats(keys, root),
        board=None if keys.board is None else board_of(keys.board, root, cell, "work.board"),
        T_on_work=frozen(pose_of(keys.origin, keys.rpy)),
        part=None if keys.box is None else Part(keys.part_name, keys.box, frozen(keys.held_at)),
        bodies=keys.bodies,
    )


def _check_cell(keys: ProgramKeys, root: Node, cell: Cell) -> None:
    """Check what depends on the cell: limits, clearance, jaws, and names of bodies; and the aim."""
    require_aim(keys.aim, keys.clearance_worth, root)
    if keys.end is not None and (rule := cell.unit.beyond_limits(keys.end)):
        raise root.error_at("end_deg", rule)
    if keys.clearance is not None and keys.clearance < cell.least_clearance:
        least = f"{1e3 * cell.least_clearance:g} (motion.least_clearance_mm of {cell.file.name})"
        raise root.error_at("clearance_mm", f"must be at least {least}")
    taken = {body.name for body in cell.fixed} | {body.name for body in cell.robot().bodies}
    for body in keys.bodies:
        if body.name in taken:
            rule = (
                f"has the body {body.name!r}, which the arm or the cell has too; names of bodies must differ"
            )
            raise root["bodies"].error(rule)
    known = taken | {body.name for body in keys.bodies}
    alike = sorted(name for name in known if re.fullmatch(rf"{re.escape(keys.part_name)} [0-9]+", name))
    if keys.box is not None and alike:
        raise root.error_at("part.name", f"makes names such as that of the body {alike[0]!r}; choose another")
    paths = [(_table_of(root, step), step) for step in keys.steps if isinstance(step, PathStep)]
    T_work_base = inverse(pose_of(keys.origin, keys.rpy))  # of a workpiece on no board
    around = () if keys.board else tuple(body.at(mul(T_work_base, body.T_base_body)) for body in cell.fixed)
    require_threads_provable(paths, cell.robot(), keys.bodies, around, known)
    for step in keys.steps:
        node = _table_of(root, step)
        match step:
            case JointStep(q=q) if rule := cell.unit.beyond_limits(q):
                raise node.error_at("joints_deg", rule)
            case Action(jaws=float()) if not cell.has_jaws:
                rule = f"cannot be done, the tool of {cell.file.name} has no jaws; leave it out"
                raise node.error_at("jaws", rule)
            case Action(jaws=float() as jaws) if keys.box is not None and jaws > 0.0:
                _require_held(keys.box[1], node, root, cell, jaws)
            case PathStep(touch=touch, clearance_of=names):
                _require_lifted(node, touch, cell.clearance if keys.clearance is None else keys.clearance)
                _require_known(node, "touch", frozenset[str]().union(*touch), known)
                _require_known(node, "clearance_of", names, known)
            case PoseStep(touch=touch):
                _require_known(node, "touch", frozenset[str]().union(*touch), known)


def _require_lifted(node: Node, touch: Pairs, clearance: float) -> None:
    """Require that strokes which touch something begin and end at the clearance from it, m."""
    if touch and "lift_mm" in node and 1e-3 * node["lift_mm"].value < clearance - 1e-9:
        rule = f"must be at least the clearance, {1e3 * clearance:g} mm: where strokes begin and end, nothing may touch"
        raise node.error_at("lift_mm", rule)


def _require_held(width: float, node: Node, root: Node, cell: Cell, closed: float) -> None:
    """Require that jaws which close by a fraction hold a part that is `width` m wide between them."""
    gripper = cell.gripper
    if not width < gripper.opening:
        rule = f"is {1e3 * width:g} mm along the tool's y axis, between jaws that open {1e3 * gripper.opening:g} mm"
        raise root.error_at("part.box_mm", rule)
    if not gripper.width(closed) < width:
        rule = f"leaves the jaws {1e3 * gripper.width(closed):g} mm apart"
        raise node.error_at("jaws", f"{rule}, and the part is {1e3 * width:g} mm wide there")


def _check_parts(keys: ProgramKeys, root: Node) -> None:
    """Check that parts are taken and put down in turn, and that the jaws open for nothing else while they hold one."""
    handles = [step for step in keys.steps if isinstance(step, PoseStep) and step.part is not None]
    if keys.box is None and ("part" in root or handles):
        rule = "is missing: the edges of the box that the steps take and put down"
        raise root.error_at("part.box_mm", rule)
    if keys.box is not None and not handles:
        raise root.error_at("part", 'is in no step: give part = "take" or "put" to a step with at_mm')
    if f"{keys.part_name} 1".startswith(_SEEN):
        raise root.error_at("part.name", "is how names of bodies begin that a look finds; choose another")
    holding = False
    for step in keys.steps * min(_repeats(keys, root), 2):
        node = _table_of(root, step)
        match step:
            case PoseStep(part=str() as part):
                if holding == (part == TAKE):
                    rule = (
                        "takes a part while the jaws hold one"
                        if holding
                        else "puts a part down, but holds none"
                    )
                    raise node.error_at("part", f"{rule}; parts are taken and put down in turn")
                holding = part == TAKE
            case Action(jaws=float()) if holding and node.get("part", text(TAKE, PUT), None) is None:
                raise node.error_at("jaws", f"would let go of the part; give part = {PUT!r}, or leave it out")


def _require_known(node: Node, key: str, names: frozenset[str], known: set[str]) -> None:
    """Require that a key names bodies that there are, or that a look may find."""
    for name in sorted(names - known):
        if not name.startswith(_SEEN):
            rule = f"names {name!r}, which is no body of the arm, the tool, the cell or the workpiece"
            raise node.error_at(key, rule, f"there are {', '.join(sorted(known))}")


def _table_of(root: Node, step: Step) -> Node:
    """Return the table of a step, whose key is such as ``steps[2]``."""
    return root["steps"].items()[int(step.key.removeprefix("steps[").removesuffix("]"))]


def _repeats(keys: ProgramKeys, root: Node) -> int:
    """Return the number of repeats: as stated, or as many as the grids have places."""
    places = {len(step.T_work_tool) for step in keys.steps if isinstance(step, PoseStep)} - {1}
    if keys.repeat is None:
        if len(places) > 1:
            shown = ", ".join(map(str, sorted(places)))
            raise root.error_at("steps", f"have grids of {shown} places; must be equal, or give repeat")
        return max(places, default=1)
    if places and keys.repeat > min(places):
        raise root.error_at("repeat", f"must be at most {min(places)}, the places of a grid of its steps")
    return keys.repeat


def _files(root: Node) -> dict[str, str]:
    """Return hashes of the files that the program names, by their names as they are written."""
    tables = [*root.value.get("bodies", ()), *root.value["steps"]]
    names = sorted({one[key] for one in tables for key in ("file", *FILES) if key in one})
    return {f"file {name}": _digest(root.file.parent / name)[:12] for name in names}


def _digest(file: Path) -> str:
    """Hash the values of a TOML file, not its text; the bytes of any other."""
    content = canonical_json(Node.of_toml(file).value) if file.suffix == ".toml" else read_bytes(file, "SVG")
    return sha256(content)


def doubts_of_file(file: Path) -> tuple[str, ...]:
    """Say of a scene, cell, task, program or arm file which values are rather meant otherwise, each with its key."""
    if kind_of_file(file) == "scene":
        return tuple(f"{file.name}: {doubt}" for doubt in scene_doubts(read_scene_file(file)))
    return tuple(place_of_file(file).doubts())
