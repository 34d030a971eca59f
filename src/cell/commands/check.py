"""``a465 check``: a plan, or a scene file. Each branch imports only what it needs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.storage import read_text
from cell.console import Console


def check_step(
    file: Path, task_file: Path | None, configuration: str | None, console: Console
) -> dict[str, Any]:
    """Check a plan (JSON; of a cell against its task), a scene file, or with --q a configuration in such a file."""
    begin = read_text(file, "JSON").lstrip()[:1]
    if not begin:
        raise InputError(f"{file}: is empty; check takes a plan or a scene file", file=str(file))
    if begin == "{" or file.suffix.lower() == ".json":
        if configuration is not None:
            raise InputError(f"{file} is a plan; --q needs a scene, cell or task file", file=str(file))
        return _check_plan(file, task_file, console)
    from cell.commands.check_scene import check_scene, closest_pairs
    from cell.files.scene import read_scene_file, read_surroundings
    from cell.program.program_file import doubts_of_file

    if task_file is not None:
        raise InputError(f"{file} is not a plan and needs no task; leave out {task_file}", file=str(file))
    if configuration is None:
        return check_scene(read_scene_file(file), console)
    result = closest_pairs(read_surroundings(file), configuration, console)
    for doubt in doubts_of_file(file):
        console.say(f"NOTE: {doubt}")
    return result


def _check_plan(plan_file: Path, task_file: Path | None, console: Console) -> dict[str, Any]:
    """Check every segment that the plan would send, independently of the clearances it states."""
    from arm.plan_file import read_plan
    from cell.commands.second_opinion import second_opinion
    from cell.config.arm_file import ArmFile
    from cell.export.scene import arm_of_plan
    from cell.files.task import Task
    from cell.program.find_task import naming_its_task, task_or_none
    from cell.program.program_file import place_of_file
    from cell.scene.options import options_of
    from cell.task.plan_matches import check_plan, replayed_to_json
    from plan.program.setting import planned_limits
    from plan.program.stated_arm import stated_options
    from plan.trajectory.virtual_unit import NO_UNIT
    from plan.verify import replay

    plan = read_plan(plan_file)
    found = task_or_none(plan_file, plan, task_file)
    place = None if found is None else place_of_file(found)
    if plan.unit == NO_UNIT:
        arm = arm_of_plan(plan_file, plan, place)
        result = replayed_to_json(plan, replay(plan, arm.scene(plan), arm.unit, arm.limits))
        robot, unit, limits, options = arm.robot_open, arm.unit, arm.limits, stated_options(plan_file, plan)
        for doubt in place.doubts() if isinstance(place, ArmFile) else ():
            console.say(f"NOTE: {doubt}")
    elif not isinstance(place, Task):
        why = f"{plan_file} is a plan of {plan.unit}, and {found} is an arm file; give its task or cell file"
        raise InputError(why, file=str(plan_file))
    else:
        if task_file is None:
            console.say(f"task: {found}")
        with naming_its_task(plan_file, plan, task_file):
            result = check_plan(place, plan)
        cell = place.cell
        robot, unit, limits, options = cell.robot(), cell.unit, cell.limits, options_of(place, plan.speed)
    columns = ["name", "stated_mm", "proved_mm"]
    header = ["move", "stated mm", "proved mm"]
    if any(m["proved_erring_mm"] is not None for m in result["moves"]):
        columns, header = [*columns, "proved_erring_mm"], [*header, "with errors mm"]
    rows = [(*(m[column] for column in columns), " - ".join(m["closest"])) for m in result["moves"]]
    console.table((*header, "closest"), rows)
    if "with errors mm" in header:
        console.say(
            "with errors: proved for every error of the arm within accuracy.sigmas standard deviations"
        )
    on = [move.threaded for move in plan.moves if move.threaded is not None]
    for line in dict.fromkeys(on):
        console.say(f"the ring stays threaded on {line}: proved for {on.count(line)} moves")
    console.say(
        f"plan {plan.sha256[:12]}: {len(result['moves'])} moves verified; at most "
        f"{100 * result['peak_velocity']:.1f} % of the velocity and {100 * result['peak_acceleration']:.1f} % of the "
        f"acceleration limits at speed {plan.speed:g}"
    )
    again = result["second_opinion"] = second_opinion(
        plan, robot, unit, planned_limits(limits, options, unit)
    )
    if again["toppra_s"] is None:
        console.say(f"toppra gives no time for {', '.join(again['unanswered'])}")
    else:
        apart = [m["percent"] for m in again["motions"]]
        console.say(
            f"toppra, on a spline through the sent motion: duration {again['toppra_s']:.2f} s; planned: "
            f"{again['planned_s']:.2f} s ({again['percent']:+.2f} %; per motion {min(apart):+.2f} to "
            f"{max(apart):+.2f} %)"
        )
    return result
