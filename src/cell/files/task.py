"""The task file: the board to empty, and the destination of its cubes; or a cell or arm file, which needs no task."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.board import Board
from arm.errors import FileInputError, InputError
from arm.io.keys import Keys, key
from arm.io.kind import kind_of
from arm.io.node import Node
from arm.io.rules import (
    flag,
    integer,
    integers,
    is_whole,
    number,
    numbers,
    path,
    rule_of,
    same,
    standing,
    text,
)
from arm.io.storage import canonical_json, sha256
from arm.io.toml_reader import read_toml
from arm.numerics.units import unit_meant
from arm.se3 import Array, frozen
from cell.config.arm_file import ARM, ArmFile, read_arm_file
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.config.doubts.angles import doubt_of_small
from cell.config.doubts.cell_doubts import cell_doubts
from cell.config.inputs import Inputs, config_inputs
from plan.options import AIMS, CHOICES, LOOKS

KINDS = ("clear-board", "board-to-board")
KIND = text(*KINDS)
POSES = "poses"  # kind of a task that was read from a cell file
NOTHING: Array = frozen(np.zeros((0, 3)))  # no further points on a board
_IDS = integers(2, 0, 999, "the two marker ids of a board, such as [1, 2]")
HOLES = (1, 2, 3, 4)  # of a board
_HOLES = rule_of(
    "different whole numbers from 1 to 4",
    lambda v: isinstance(v, list) and bool(v) and all(is_whole(n, 1, 4) for n in v) and len(set(v)) == len(v),
    tuple,
)
_LOOK_AFTER = f"one of {', '.join(LOOKS)}, or a number of cubes, 1 or more"


@dataclass(frozen=True)
class TablePlaces:
    """A grid of places on the table for Task 1.

    Attributes:
        centres: positions (n, 2), m, in the base frame, in order of preference.
        yaw: yaw of a cube there, rad.
    """

    centres: tuple[tuple[float, float], ...]
    yaw: float


class TaskValues(Keys):
    """Values of a task file that are used unchanged.

    With ``free``, the planner chooses the order or the destinations of the cubes for the least time. With ``given``,
    the cubes move in the order of their holes, each to the next free place. With `skip`, a cube that is doubtful, out
    of reach or blocked stays where it is, and the others move.
    """

    look_after: str | int = key(
        "look_after", rule_of(_LOOK_AFTER, lambda v: v in LOOKS or is_whole(v, 1), same), "each"
    )
    order: str = key("order", text(*CHOICES), "free")
    assignment: str = key("assignment", text(*CHOICES), "free")
    skip: bool = key("skip", flag(), False)
    aim: str = key("aim", text(*AIMS), "time")
    clearance_worth: float | None = key("clearance_worth_s_per_mm", number("s/mm", 0.001, 10000.0), None)
    seed: int = key("seed", integer(0, 2**31 - 1), 0)


class Task(TaskValues):
    """A task of a cell: `TaskValues`, and what the rest of its file describes.

    Attributes:
        file: task file.
        kind: clear-board (Task 1) or board-to-board (Task 2).
        cell: cell of the task.
        from_board: board that holds the cubes.
        to_board: board that receives them (Task 2), or None.
        to_holes: holes of that board that may receive one, 1 to 4.
        places: places on the table (Task 1), or None.
        board_height: height of the plate's top above the table (Task 1), m, or None.
        inputs: values of the file by key; see `cell.config.inputs`.
        digest: SHA-256 of the contents of task and cell file.
    """

    file: Path
    kind: str
    cell: Cell
    from_board: Board
    to_board: Board | None = None
    to_holes: tuple[int, ...] = HOLES
    places: TablePlaces | None = None
    board_height: float | None = None
    inputs: Inputs
    digest: str

    @property
    def name(self) -> str:
        """Stem of the file."""
        return self.file.stem

    @property
    def boards(self) -> tuple[Board, ...]:
        """Boards that a look must detect; none for poses in a cell."""
        if self.kind == POSES:
            return ()
        return (self.from_board,) if self.to_board is None else (self.from_board, self.to_board)

    @property
    def on_board(self) -> Array:
        """Corners of boxes around bodies that stand on the board, beside its cubes, in its frame, (k, 3) m."""
        return NOTHING

    def doubts(self) -> tuple[str, ...]:
        """Say which values of the files may be in another unit; see `cell.config.doubts`."""
        return (*cell_doubts(self.cell), *self.own_doubts())

    def own_doubts(self) -> tuple[str, ...]:
        """Say which values of the task file may be in another unit."""
        yaw = None if self.places is None else round(float(np.degrees(self.places.yaw)), 6)
        doubt = "" if yaw is None else doubt_of_small(yaw)
        found = [f"places.yaw_deg = {doubt}"] if doubt else []
        holes = 0 if self.kind == POSES else len(self.from_board.holes)
        if isinstance(self.look_after, int) and self.look_after > holes > 0:
            found.append(
                f"look_after = {self.look_after}: is more than the {holes} cubes of a board: no look follows"
            )
        return tuple(f"{self.file.name}: {words}" for words in found)


class TaskKeys(TaskValues):
    """Keys of every task file."""

    task: str = key("task", KIND)
    cell: Path = key("cell", path())
    from_board: tuple[int, ...] = key("from_board", _IDS)


class Task1Keys(TaskKeys, file="a task file of clear-board"):
    """Keys of Task 1."""

    board_height: float = key("board_height_mm", number("mm", 15, 1000))
    origin: Array = key("places.origin_mm", standing(2, -2000, 2000))
    step: Array = key("places.step_mm", numbers(2, "mm", 0, 500))
    count: tuple[int, ...] = key("places.count", integers(2, 1, 20))
    yaw: float = key("places.yaw_deg", number("deg", -360, 360), 0)


class Task2Keys(TaskKeys, file="a task file of board-to-board"):
    """Keys of Task 2."""

    to_board: tuple[int, ...] = key("to_board", _IDS)
    to_holes: tuple[int, ...] = key("to_holes", _HOLES, list(HOLES))


def task_or_cell(path: Path) -> Node:
    """Read a TOML file that may be a task, program, cell or arm file.

    Raises:
        InputError: it cannot be read; of a folder, the message names the task files in it.
    """
    if path.is_dir():
        tasks = tasks_in(path)
        help = f"give a task file of it: {', '.join(tasks)}" if tasks else "it holds no task file"
        raise FileInputError(path, "", None, "is a folder, must be a file", help)
    return Node.of_toml(path, "task", "program", "cell", "arm")


def tasks_in(folder: Path) -> list[str]:
    """Return the names of the task files in a folder, with their path."""
    return [str(file) for file in sorted(folder.glob("*.toml")) if _is_task(file)]


def is_task_file(root: Node) -> bool:
    """Whether the content of a file is a task's, perhaps without its key `task`."""
    return "task" in root or kind_of(root.value) == "task"


def _is_task(file: Path) -> bool:
    with suppress(InputError):
        return kind_of(read_toml(file)) == "task"
    return False


def cell_of(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> Cell:
    """Read a cell file, or the one that a task file names; see `read_task`."""
    is_task = is_task_file(task_or_cell(path))
    return read_task(path, on_uncalibrated).cell if is_task else read_cell(path, on_uncalibrated)


def read_task(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> Task:
    """Read a task file and the cell file that it names.

    Args:
        path: the file.
        on_uncalibrated: see `cell.config.cell_file.read_cell`.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = task_or_cell(path)
    root.require_kind("task")
    is_clear_board = root.get("task", KIND) == KINDS[0] if "task" in root else "to_board" not in root
    keys = Task1Keys.read(root) if is_clear_board else Task2Keys.read(root)
    require_aim(keys.aim, keys.clearance_worth, root)
    cell = read_cell(keys.cell, on_uncalibrated)
    if not cell.has_jaws:
        rule = "names a cell whose tool has no jaws (its tool.bodies): tasks move cubes"
        raise root.error_at("cell", rule, "a465 plan takes a list of poses for such a cell")
    to_board = places = height = None
    to_holes: tuple[int, ...] = HOLES
    if isinstance(keys, Task1Keys):
        places, height = _places(keys, root, cell), keys.board_height
    else:
        to_board, to_holes = board_of(keys.to_board, root, cell, "to_board"), keys.to_holes
        if set(keys.to_board) == set(keys.from_board):
            raise root.error_at("to_board", "must be another board than from_board")
    inputs = config_inputs(root.value, left_out=("cell",))
    return Task(
        file=path,
        kind=keys.task,
        cell=cell,
        from_board=board_of(keys.from_board, root, cell, "from_board"),
        to_board=to_board,
        to_holes=to_holes,
        places=places,
        board_height=height,
        **keys.values_of(TaskValues),
        inputs=inputs,
        digest=sha256(sha256(canonical_json(inputs)) + cell.digest),
    )


def require_aim(aim: str, worth: float | None, root: Node) -> None:
    """Refuse ``clearance_worth_s_per_mm`` of a task or program whose aim does not use it.

    Raises:
        FileInputError: the aim is another than clearance.
    """
    if worth is not None and aim != "clearance":
        rule = f'needs aim = "clearance", and aim is "{aim}"'
        raise root.error_at("clearance_worth_s_per_mm", rule)


def place_or_arm(path: Path) -> Task | ArmFile:
    """Read an arm file, or what `read_place` reads.

    Raises:
        InputError: the file is none of them, or is wrong.
    """
    root = task_or_cell(path)
    return read_arm_file(path) if ARM in root or kind_of(root.value) == ARM else read_place(path)


def read_place(path: Path) -> Task:
    """Read a task file, or a cell file as a task of kind `POSES` without boards.

    Raises:
        InputError: the file is neither, or is wrong.
    """
    if is_task_file(task_or_cell(path)):
        return read_task(path)
    cell = read_cell(path)
    return Task(
        file=cell.file,
        kind=POSES,
        cell=cell,
        from_board=cell.boards[0],  # required, but unused without cubes to move
        look_after="never",
        order="given",
        assignment="given",
        skip=False,
        aim="time",
        clearance_worth=None,
        seed=0,
        inputs={},
        digest=sha256(sha256(canonical_json({})) + cell.digest),
    )


def board_of(ids: tuple[int, ...], root: Node, cell: Cell, key: str) -> Board:
    """Return the board of a cell with these two marker ids, the value of a key of a file.

    Raises:
        InputError: the cell file lists no such board.
    """
    for board in cell.boards:
        if set(board.marker_ids) == set(ids):
            return board
    known = ", ".join(str(list(b.marker_ids)) for b in cell.boards)
    raise root.error_at(key, f"must be the two marker ids of a board that {cell.file.name} lists: {known}")


def _places(keys: Task1Keys, root: Node, cell: Cell) -> TablePlaces:
    gap = cell.cube_size * np.sqrt(2.0) + 0.005
    if keys.step.min() < gap:
        rule = f"must be 2 numbers in mm from {1e3 * gap:g} to 500"
        raise root.error_at("places.step_mm", rule, unit_meant(1e3 * keys.step, "mm", 1e3 * gap, 500.0))
    nx, ny = keys.count
    if nx * ny < 4:
        raise root.error_at("places.count", "must make at least four places")
    (x, y), (dx, dy) = keys.origin.tolist(), keys.step.tolist()
    return TablePlaces(tuple((x + i * dx, y + j * dy) for j in range(ny) for i in range(nx)), keys.yaw)
