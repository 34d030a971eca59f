"""The cell of a plan, from a task file or from a cell file without a task."""

from __future__ import annotations

from pathlib import Path

from arm.io.storage import canonical_json, sha256
from cell.config.cell_file import read_cell
from cell.files.task import Task, read_task, task_or_cell

POSES = "poses"  # kind of a task that was read from a cell file


def read_place(path: Path) -> Task:
    """Read a task file, or a cell file as a task of kind `POSES` without boards.

    Raises:
        InputError: the file is neither, or is wrong.
    """
    if "task" in task_or_cell(path):
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
