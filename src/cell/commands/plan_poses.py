"""``a465 plan`` of a list of poses, and of a program file: poses and configurations become a certified plan file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from arm.io.outputs import keep_apart
from arm.io.storage import keep_unread
from arm.plan_file import Move, Plan, write_plan
from cell.accuracy.clearances import erring_clearances
from cell.commands.manual.teach import taught_otherwise
from cell.commands.steps import move_to_json, warn_of
from cell.config.arm_file import ArmFile
from cell.config.cell import Cell
from cell.config.doubts.angles import doubt_of_deg, doubt_of_small
from cell.console import Console
from cell.files.observation import read_observation, require_boards
from cell.files.pose_list import PoseList, read_pose_list
from cell.files.reading import Reading
from cell.files.task import POSES, place_or_arm
from cell.program.doubts.depths import buried, depths
from cell.program.doubts.hints import in_metres, turned_up, unplaced
from cell.program.doubts.stated import stated_doubts
from cell.program.doubts.taken import taken_from_air
from cell.program.path_speeds import HEADER, KeptSpeed, path_speeds
from cell.program.planning import T_base_work, plan_of_program
from cell.program.program_file import ProgramTask, is_program, read_program
from cell.program.steps import Action
from cell.session.budget import within
from cell.session.speed import planning_speed, tool_words
from cell.task.explain import explain_list_failure
from cell.task.planning import require_above_table
from cell.task.pose_list_planning import place_of_arm, place_of_cell, plan_pose_list
from cell.task.programs.reach import program_reach, require_reach
from plan.budget import SearchBudget
from plan.kinematics.product_of_exponentials import product_of_exponentials
from vision.observation import Observation

_IN_JAWS = "objects in the jaws are unknown and not checked for collisions"
_PARTS = "parts are checked for collisions as the program has them; whether the jaws hold one is not checked"


def _angle_doubts(poses: PoseList, cell: Cell) -> Iterator[str]:
    """Say of the first configuration in deg that may be in rad that it may be."""
    for entry in poses.entries:
        if entry.in_deg and entry.q is not None and (doubt := doubt_of_deg(entry.q, cell.unit)):
            yield f"NOTE: {poses.file.name}: {entry.key} = {doubt}"
            return


def _small_angles(poses: PoseList) -> Iterator[str]:
    """Say of the first tilt or range in deg that may be in rad that it may be; and of a speed that it has no effect."""
    for entry in poses.entries:
        angles = {"tilt_deg": [entry.tilt]}
        angles |= {f"ranges.{name}_deg": list(entry.ranges[name]) for name in entry.ranges if name[0] == "r"}
        for key, values in angles.items():
            in_deg = [round(float(np.degrees(v)), 9) for v in values]
            if doubt := doubt_of_small(in_deg if len(in_deg) > 1 else in_deg[0]):
                yield f"NOTE: {poses.file.name}: {entry.key}.{key} = {doubt}"
                return
    for entry in poses.entries:
        if entry.speed is not None and entry.by == "transit" and not entry.approach and not entry.retract:
            rule = 'has no effect without lines: give by = "line", approach_mm or retract_mm'
            yield f"NOTE: {poses.file.name}: {entry.key}.speed_mm_s: {rule}"
            return


def plan_poses_step(
    place_file: Path,
    poses_file: Path,
    look: Path | None,
    output: Path,
    reading: Reading,
    speed: float | None,
    back: bool,
    console: Console,
    budget: SearchBudget | None = None,
    advice: bool = False,
) -> dict[str, Any]:
    """Plan from q_start through the whole list, write the plan file and return a summary as JSON types.

    Args:
        place_file: task file, cell file or arm file.
        poses_file: the list; see `cell.files.pose_list.read_pose_list`.
        look: detected boards; None: only the table and the walls.
        output: plan file to write.
        reading: units and frame of entries that state none.
        speed: see `cell.session.speed`; default: the cell's.
        back: whether the arm returns to q_start at the end.
        advice: whether to explain a refusal, with changes that would help.

    Raises:
        InputError: a file or value is wrong.
        ImpossibleError: an entry (named) is out of reach or has too little clearance, or an arm with its errors has.
    """
    keep_apart(output, place_file, poses_file, look, kind="plan")
    keep_unread(output)
    seen, explain = None, None
    if is_program(place_file):
        why = f"{place_file} is a program file, which has its steps itself: leave out {poses_file}, or give a cell file"
        raise InputError(why, file=str(place_file))
    task = place_or_arm(place_file)
    if isinstance(task, ArmFile):
        if look is not None:
            raise InputError(f"--look does not go with an arm file ({place_file})", option="look")
        for doubt in task.doubts():
            console.say(f"NOTE: {doubt}")
        place = place_of_arm(task, planning_speed(task, speed))
        slides = any(axis.slides for axis in product_of_exponentials(task.robot).axes)
        reading = replace(reading, joints=len(task.q_start), slides=slides)
    else:
        for doubt in task.doubts():
            console.say(f"NOTE: {doubt}")
        if look is not None:
            seen = read_observation(look, task.cell)
            if task.kind != POSES:
                require_boards(seen, task, look)
            require_above_table(task, seen)
        place = place_of_cell(task, seen, planning_speed(task.cell, speed))
        explain = partial(explain_list_failure, task, seen) if advice else None
    poses = read_pose_list(poses_file, reading)
    if reading.frame is not None and all(entry.T is None for entry in poses.entries):
        why = (
            f"--frame {reading.frame}: is of poses, and {poses_file} has joint angles only; x y z roll pitch yaw is "
            "not read: give a pose as 12 or 16 numbers a row"
        )
        raise InputError(why, option="--frame", file=str(poses_file))
    if not isinstance(task, ArmFile):
        for line in (*_angle_doubts(poses, task.cell), *taught_otherwise(poses, task.cell)):
            console.say(line)
    for line in _small_angles(poses):
        console.say(line)
    with within(budget):
        plan = plan_pose_list(place, poses, back, explain)
    erring = () if isinstance(task, ArmFile) else erring_clearances(task.cell, plan, seen)
    write_plan(output, plan)
    _print_steps(plan, erring, console)
    least = 1e3 * min(m.clearance for m in plan.moves)
    console.say(
        f"{len(poses.entries)} entries, {plan.duration_s:.1f} s at speed {plan.speed:g}, "
        f"{tool_words(plan, place.scene.robot_holding, place.unit)}, "
        f"clearance at least {least:.1f} mm"
    )
    warn_of(plan, console)
    if seen is None and not isinstance(task, ArmFile):
        console.say("this plan considers only the table and the walls; add boards and cubes with --look FILE")
    if any(entry.jaws for entry in poses.entries):
        console.say(_IN_JAWS)
    console.say(f"plan {plan.sha256[:12]} written to {output}")
    return {
        "plan": str(output),
        "plan_sha256": plan.sha256,
        "entries": len(poses.entries),
        "motion_s": plan.duration_s,
        "min_clearance_mm": least,
        "stopped": plan.notes.get("search"),
        "boards": None if seen is None else [b.name for b in seen.boards],
        "poses": plan.task["poses"],
        "moves": [
            {
                "name": m.name,
                "motion_s": m.path.duration_s,
                "clearance_mm": 1e3 * m.clearance,
                "clearance_with_errors_mm": None if of is None else 1e3 * of,
            }
            for m, of in zip_longest(plan.moves, erring)
        ],
    }


def plan_program_step(
    program_file: Path,
    look: Path | None,
    output: Path,
    speed: float | None,
    console: Console,
    advice: bool = True,
    budget: SearchBudget | None = None,
) -> dict[str, Any]:
    """Plan from q_start through all steps of a program, write the plan file and return a summary as JSON types.

    Args:
        program_file: see `cell.program.program_file`.
        look: detected boards; needed if the workpiece is on one.
        output: plan file to write.
        speed: see `cell.session.speed`; default: the cell's.
        advice: whether to explain a refusal, with changes that would help.

    Raises:
        InputError: a file or value is wrong, or the look is missing.
        ImpossibleError: a step (named) is out of reach or has too little clearance, or an arm with its errors has.
    """
    keep_apart(output, program_file, look, kind="plan")
    keep_unread(output)
    task, seen = _task_and_look(program_file, look, console)
    T = T_base_work(task, seen)
    for doubt in (*buried(task, T), *taken_from_air(task, T), *depths(task, T)):
        console.say(f"NOTE: {doubt}")
    explain = partial(explain_list_failure, task, seen) if advice else None
    with within(budget):
        plan = plan_of_program(task, seen, planning_speed(task.cell, speed), explain)
    erring = erring_clearances(task.cell, plan, seen)
    write_plan(output, plan)
    _print_steps(plan, erring, console)
    speeds = path_speeds(task, plan)
    if speeds:
        console.table(HEADER, [one.row() for one in speeds])
    for kept in plan.task.get("kept_speeds", ()):
        console.say(KeptSpeed.from_json(kept).words())
    least = 1e3 * min(m.clearance for m in plan.moves)
    console.say(
        f"{task.title}: {plan.duration_s:.1f} s at speed {plan.speed:g}, "
        f"{tool_words(plan, task.cell.robot_holding(), task.cell.unit)}, clearance at least {least:.1f} mm"
    )
    warn_of(plan, console)
    if task.part is not None:
        console.say(_PARTS)
    elif any(isinstance(step, Action) and step.jaws for step in task.steps):
        console.say(_IN_JAWS)
    console.say("a clearance is a distance between bodies as the files describe them, less padding")
    console.say(task.cell.arm_shape())
    console.say(f"plan {plan.sha256[:12]} written to {output}")
    return {
        "plan": str(output),
        "plan_sha256": plan.sha256,
        "title": task.title,
        "speed": plan.speed,
        "motion_s": plan.duration_s,
        "min_clearance_mm": least,
        "stopped": plan.notes.get("search"),
        "boards": [board.name for board in seen.boards],
        "reached": plan.task["reached"],
        "moves": [move_to_json(m, of) for m, of in zip_longest(plan.moves, erring)],
        "path_speeds": [one.to_json() for one in speeds],
    }


def reach_program_step(program_file: Path, look: Path | None, console: Console) -> dict[str, Any]:
    """``a465 reach`` of a program: which stations of its paths and poses the arm can reach, and why not.

    Raises:
        InputError: a file is wrong, or the look is missing.
        ImpossibleError: the arm cannot be at a station; names it.
    """
    task, seen = _task_and_look(program_file, look, console)
    stations = program_reach(task, seen, planning_speed(task.cell, None))
    console.table(
        ("step", "path mm", "x mm", "y mm", "z mm", "sampled solutions", "what limits it"),
        [(s.step, 1e3 * s.place, *(1e3 * v for v in s.position), s.solutions, s.reason()) for s in stations],
    )
    beyond = [one for one in stations if one.best is None]
    turned = turned_up(task, beyond[0].pose.T_base_tool) + unplaced(task) if beyond else ""
    require_reach(stations, turned + in_metres(task))
    return {
        "stations": [
            {
                "step": s.step,
                "place_mm": 1e3 * s.place,
                "position_mm": [1e3 * v for v in s.position],
                "solutions": s.solutions,
            }
            for s in stations
        ]
    }


def _task_and_look(
    program_file: Path, look: Path | None, console: Console
) -> tuple[ProgramTask, Observation]:
    """Read a program and the look that it needs; print which joint angles are doubtful.

    Raises:
        InputError: a value is wrong, or the look is missing.
    """
    task = read_program(program_file)
    for doubt in (*task.doubts(), *stated_doubts(task)):
        console.say(f"NOTE: {doubt}")
    if look is None and task.board is not None:
        why = f"--look is missing: the workpiece of {program_file} is on board {task.board.name}"
        raise InputError(why, option="--look")
    seen = Observation() if look is None else read_observation(look, task.cell)
    if look is not None:
        require_boards(seen, task, look)
    return task, seen


def _print_steps(plan: Plan, erring: Sequence[float], console: Console) -> None:
    left = iter(erring)
    rows = [
        (
            s.name,
            *((s.path.duration_s, 1e3 * s.clearance) if isinstance(s, Move) else (None, None)),
            *((1e3 * next(left) if isinstance(s, Move) else None,) if erring else ()),
            " - ".join(s.closest) if isinstance(s, Move) else "",
        )
        for s in plan.steps
    ]
    console.table(
        ("step", "duration s", "clearance mm", *(["with errors mm"] if erring else []), "closest"), rows
    )
