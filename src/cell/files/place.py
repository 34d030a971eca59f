"""The place of a plan: a cell, from a task file or from a cell file without a task, or the arm of an arm file."""

from __future__ import annotations

from pathlib import Path

from arm.io.storage import canonical_json, sha256
from cell.config.arm_file import ARM, ArmFile, read_arm_file
from cell.config.cell_file import read_cell
from cell.files.task import Task, read_task, task_or_cell

POSES = "poses"  # kind of a task that was read from a cell file


def place_or_arm(path: Path) -> Task | ArmFile:
    """Read an arm file, or what `read_place` reads.

    Raises:
        InputError: the file is none of them, or is wrong.
    """
    return read_arm_file(path) if ARM in task_or_cell(path) else read_place(path)


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
