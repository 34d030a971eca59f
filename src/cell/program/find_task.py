"""The task, program or cell file that a plan was made for, found near the plan by its name and content."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from arm.errors import FileInputError, ImpossibleError, InputError
from arm.io.storage import canonical_json
from arm.plan_file import Plan, read_plan
from cell.files.task import Task
from cell.program.program_file import place_of_file
from cell.scene.fingerprint import plan_fingerprint
from plan.trajectory.virtual_unit import NO_UNIT

DEEPEST = 3  # folders below the present one
MOST_TOLD = 2  # files of the name that do not fit
MOST_FOLDERS = 2000  # that are looked through


def task_of_plan_file(plan_file: Path) -> Path:
    """Return the file of a plan's task.

    It has the plan's name for it and its content (values, not text), and is in the plan's folder, a folder above that
    up to the present one, or one at most `DEEPEST` below the present one; the first of these whose cell is that of the
    plan, or else the first, so that whoever compares can say what differs.

    Raises:
        InputError: there is none; the message names files of that name that do not fit.
    """
    return _found(plan_file, read_plan(plan_file))


def task_or_none(plan_file: Path, plan: Plan, given: Path | None) -> Path | None:
    """Return `given`, or else the file of the plan's task; None for a plan of an arm without a unit, which needs none.

    Raises:
        InputError: as `task_of_plan_file`.
    """
    return given if given is not None or plan.unit == NO_UNIT else _found(plan_file, plan)


@contextmanager
def naming_its_task(plan_file: Path, plan: Plan, given: Path | None) -> Iterator[None]:
    """Add to a refusal of a plan with the file `given` which other file near the plan it was made for.

    Raises:
        ImpossibleError: as raised inside, and there is such a file, whose cell is that of the plan.
    """
    try:
        yield
    except ImpossibleError as error:
        with suppress(InputError):
            other = _found(plan_file, plan)
            place = place_of_file(other)
            if (
                given is not None
                and not other.samefile(given)
                and isinstance(place, Task)
                and _fits(place, plan)
            ):
                why = str(error).removesuffix("; plan again").removesuffix("; give its file or plan again")
                raise ImpossibleError(f"{why}; it was made for {other}: give that", **error.data) from error
        raise


def _found(plan_file: Path, plan: Plan) -> Path:
    name, digest = plan.task.get("name"), plan.provenance.get("task")
    if not isinstance(name, str) or Path(name).name != name:
        raise FileInputError(
            plan_file, "task.name", name, "must be the name of a task; give its task file too"
        )
    others: list[str] = []
    first: Path | None = None
    for file in _near(plan_file, f"{name}.toml"):
        try:
            place = place_of_file(file)
        except InputError as error:
            others.append(str(error))
            continue
        if isinstance(place, Task) and place.digest == digest:
            if _fits(place, plan):
                return file
            first = first or file
            continue
        others.append(f"{file} is not as it was when the plan was made")
    if first is not None:
        return first
    why = f"{plan_file} is a plan of {name!r}, and there is no {name}.toml here that it was made for"
    seen = f" ({'; '.join(others[:MOST_TOLD])})" if others else ""
    raise InputError(f"{why}{seen}; give its task file too: {plan_file} TASK", file=str(plan_file), name=name)


def _fits(task: Task, plan: Plan) -> bool:
    """Whether the plan is for the present cell of a task: two cells may have the same task."""
    now, then = plan_fingerprint(task), plan.provenance
    return all(
        canonical_json(now[key]) == canonical_json(then.get(key))
        for key in ("calibration_id", "inputs", "limits")
    )


def _near(plan_file: Path, name: str) -> Iterator[Path]:
    """Yield files of a name near a plan, the nearest first, each once."""
    here, known = Path.cwd().resolve(), set[Path]()
    folder = plan_file.resolve().parent
    above = [folder, *folder.parents] if folder.is_relative_to(here) else [folder]
    for place in (*(one for one in above if one == folder or one.is_relative_to(here)), *_below(here)):
        file = place / name
        if file not in known and os.path.isfile(file):
            known.add(file)
            yield file.relative_to(here) if file.is_relative_to(here) else file


def _below(folder: Path) -> Iterator[Path]:
    """Yield a folder and those at most `DEEPEST` below it, level by level; hidden ones are left out."""
    level, left = [folder], MOST_FOLDERS
    for depth in range(DEEPEST + 1):
        below: list[Path] = []
        for place in level:
            if left == 0:
                return
            left -= 1
            yield place
            if depth < DEEPEST and len(below) < left:
                below += _folders(place)
        level = below


def _folders(folder: Path) -> list[Path]:
    """Return the folders in a folder by name, without links; none if it may not be read."""
    with suppress(OSError), os.scandir(folder) as entries:
        found = [e.name for e in entries if not e.name.startswith(".") and e.is_dir(follow_symlinks=False)]
        return [folder / name for name in sorted(found)]
    return []
