"""``a465 preview`` of a plan, or of a log. Each branch imports only what it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.errors import ImpossibleError, InputError
from arm.io.kind import kind_of_file
from arm.io.outputs import PAGES, keep_page
from arm.io.storage import keep_unread
from cell.console import Console


def preview_file(
    file: Path,
    task: Path | None,
    output: Path | None,
    console: Console,
    look: Path | None = None,
    image: Path | None = None,
) -> dict[str, Any]:
    """Write the page of a plan or a log, as the content of the file decides; by default beside the file.

    A plan that does not match the present cell is shown with a warning. With a look, its placements are shown too,
    with an image, what the camera took.

    Raises:
        InputError: a plan of a cell needs its task file, and a plan of an arm without a unit has none.
    """
    from driver.log.read import is_log

    if output is None and file.suffix.lower() in PAGES:
        why = f"{file}: is named as a page, which a browser opens; preview takes a plan or a log"
        raise InputError(why, file=str(file))
    keep_page(output, file, task, look, image)
    output = output or file.with_suffix(".html")
    keep_unread(output)
    if is_log(file):
        from cell.preview.of_log import preview_log

        for option, given in (("look", look), ("image", image)):
            if given is not None:
                raise InputError(f"--{option} goes with a plan; {file} is a log", option=option)
        return preview_log(file, task, output, console)
    if kind_of_file(file) == "log":
        why = f"{file}: is part of a log: its first line, of the kind open, is missing; give the whole log"
        raise InputError(why, file=str(file))
    return _preview_plan(file, task, output, console, look, image)


def _preview_plan(
    plan_file: Path,
    task_file: Path | None,
    output: Path,
    console: Console,
    look: Path | None,
    image: Path | None,
) -> dict[str, Any]:
    from arm.plan_file import read_plan
    from cell.accuracy.error_model import ErrorModel
    from cell.accuracy.plan_budgets import plan_budgets
    from cell.export.scene import arm_of_plan
    from cell.files.observation import read_observation
    from cell.files.task import Task
    from cell.preview.of_place import photograph_for
    from cell.preview.of_plan import write_page
    from cell.preview.page import Drawn, write_preview
    from cell.program.find_task import naming_its_task, task_or_none
    from cell.program.program_file import place_of_file
    from cell.task.plan_matches import require_match
    from plan.trajectory.virtual_unit import NO_UNIT

    plan, warning = read_plan(plan_file), None
    found = task_or_none(plan_file, plan, task_file)
    task = None if found is None else place_of_file(found)
    if plan.unit == NO_UNIT:
        if image is not None:
            raise InputError(f"--image goes with a plan of a cell; {plan_file} has no unit", option="image")
        arm = arm_of_plan(plan_file, plan, task)
        write_preview(plan, arm.robot_open, arm.robot_holding, arm.unit, output)
    elif not isinstance(task, Task):
        why = f"{plan_file} is a plan of {plan.unit}, and {found} is an arm file; give its task or cell file"
        raise InputError(why, file=str(plan_file))
    else:
        try:
            with naming_its_task(plan_file, plan, task_file):
                require_match(task, plan)
        except ImpossibleError as error:
            if "unit" in error.data["differing"]:  # on another unit, the same counts are other angles
                raise
            warning = str(error)
        known = look is not None and ErrorModel.available(task.cell)
        seen = read_observation(look, task.cell) if look is not None else None
        budgets = plan_budgets(task.cell, seen, plan) if known and seen else ()
        drawn = Drawn(camera=task.cell.camera)
        photograph = None if image is None else photograph_for(drawn, image, plan_file)
        write_page(task, plan, output, budgets, photograph=photograph)
    if found is not None and task_file is None:
        console.say(f"task: {found}")
    if warning is not None:
        console.say(f"WARNING: {warning}; the page shows it in the present cell, but execute would refuse it")
    console.say(f"open {output} in a browser")
    result = {"page": str(output), "plan_sha256": plan.sha256, "bytes": output.stat().st_size}
    return result if warning is None else {**result, "warning": warning}
