"""The task file: the board to empty, and the destination of its cubes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.board import Board
from arm.errors import InputError
from arm.io.storage import canonical_json, sha256
from arm.io.toml_reader import TomlTable
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.config.inputs import Inputs, config_inputs
from plan.options import CHOICES, LOOKS

KINDS = ("clear-board", "board-to-board")


@dataclass(frozen=True)
class TablePlaces:
    """A grid of places on the table for Task 1.

    Attributes:
        centres: positions (n, 2), m, in the base frame, in order of preference.
        yaw: yaw of a cube there, rad.
    """

    centres: tuple[tuple[float, float], ...]
    yaw: float


@dataclass(frozen=True)
class Task:
    """A task of a cell.

    Attributes:
        file: task file.
        kind: clear-board (Task 1) or board-to-board (Task 2).
        cell: cell of the task.
        from_board: board that holds the cubes.
        to_board: board that receives them (Task 2), or None.
        places: places on the table (Task 1), or None.
        board_height: height of the plate's top above the table (Task 1), m, or None.
        look_after: ``each`` cube, ``never``, or the number of cubes between looks.
        order, assignment: ``free``: the order of the cubes and their destinations are chosen for time; ``given``: cubes
            in the order of their holes, each to the next free place.
        seed: seed of every random choice.
        inputs: values of the file by key; see `cell.config.inputs`.
        digest: SHA-256 of the contents of task and cell file.
    """

    file: Path
    kind: str
    cell: Cell
    from_board: Board
    to_board: Board | None
    places: TablePlaces | None
    board_height: float | None
    look_after: str | int
    order: str
    assignment: str
    seed: int
    inputs: Inputs
    digest: str

    @property
    def name(self) -> str:
        """Stem of the file."""
        return self.file.stem

    @property
    def boards(self) -> tuple[Board, ...]:
        """Boards that a look must detect."""
        return (self.from_board,) if self.to_board is None else (self.from_board, self.to_board)


def read_task(path: Path, on_uncalibrated: Callable[[InputError], None] | None = None) -> Task:
    """Read a task file and the cell file that it names.

    Args:
        path: the file.
        on_uncalibrated: see `cell.config.cell_file.read_cell`.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    root = TomlTable.read(path)
    kind = root.text("task", choices=KINDS)
    cell = read_cell(root.path("cell"), on_uncalibrated)
    from_board = _board(root, cell, "from_board")
    to_board = places = height = None
    if kind == "board-to-board":
        to_board = _board(root, cell, "to_board")
        if to_board == from_board:
            raise root.error("to_board", "must be another board than from_board")
    else:
        places = _places(root.table("places"), cell)
        height = root.number("board_height_mm", "mm", 15, 1000) / 1e3
    look_after = _look_after(root)
    order, assignment = (root.text(key, choices=CHOICES, default="free") for key in ("order", "assignment"))
    seed = root.integer("seed", 0, 2**31 - 1, default=0)
    root.finish()
    inputs = config_inputs(root.value_dict(), left_out=("cell",))
    return Task(
        file=path,
        kind=kind,
        cell=cell,
        from_board=from_board,
        to_board=to_board,
        places=places,
        board_height=height,
        look_after=look_after,
        order=order,
        assignment=assignment,
        seed=seed,
        inputs=inputs,
        digest=sha256(sha256(canonical_json(inputs)) + cell.digest),
    )


def _look_after(root: TomlTable) -> str | int:
    if "look_after" not in root:
        return "each"
    rule = f"one of {', '.join(LOOKS)}, or a number of cubes from 1 on"
    value = root.value("look_after", rule)
    if value in LOOKS or (isinstance(value, int) and not isinstance(value, bool) and value >= 1):
        return value  # type: ignore[no-any-return]
    raise root.error("look_after", f"must be {rule}")


def _board(root: TomlTable, cell: Cell, key: str) -> Board:
    low, high = root.integers(key, 2, 0, 999)
    for board in cell.boards:
        if set(board.marker_ids) == {low, high}:
            return board
    known = ", ".join(str(list(b.marker_ids)) for b in cell.boards)
    raise root.error(key, f"must be the two marker ids of a board that {cell.file.name} lists: {known}")


def _places(table: TomlTable, cell: Cell) -> TablePlaces:
    origin = table.numbers("origin_mm", 2, "mm", -2000, 2000) / 1e3
    gap = 1e3 * (cell.cube_size * np.sqrt(2.0) + 0.005)
    step = table.numbers("step_mm", 2, "mm", gap, 500) / 1e3
    nx, ny = table.integers("count", 2, 1, 20)
    if nx * ny < 4:
        raise table.error("count", "must make at least four places")
    yaw = float(np.radians(table.number("yaw_deg", "deg", -360, 360, default=0.0)))
    table.finish()
    centres = tuple(
        (float(origin[0] + i * step[0]), float(origin[1] + j * step[1])) for j in range(ny) for i in range(nx)
    )
    return TablePlaces(centres, yaw)
