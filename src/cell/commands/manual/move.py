"""``a465 move``: a certified motion from where the arm is to joint angles, a tool position, or a pose of a list.

The goal becomes a list of one pose in the run folder, and is planned as `a465 plan` plans lists.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.arguments import option_numbers
from arm.errors import FileInputError, ImpossibleError, InputError
from arm.io.storage import write_atomic
from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.se3 import Array
from cell.accuracy.clearances import erring_clearances
from cell.commands.manual.session import (
    UNSEEN,
    arrive,
    beside,
    explaining_zone,
    manual_speed,
    q_now,
    require_person,
    require_seen,
    scene_now,
)
from cell.commands.manual.teach import taught_otherwise
from cell.config.cell import Cell
from cell.config.doubts.angles import doubt_of_deg, doubt_of_turn
from cell.console import Console
from cell.files.pose_list import PoseList, read_pose_list
from cell.files.reading import Reading
from cell.files.task import read_place
from cell.session.homed import home_or_check
from cell.task.pose_list_planning import place_of_cell, plan_pose_list
from cell.task.run import TaskRun

GOALS = {"q": 6, "turn": 6, "to": 3, "by": 3, "along": 3}  # number of values of each kind of goal
TOOL = ("to", "by", "along")
NAME = "the goal"
POSES = "poses.json"
FARTHEST_MM, FEW_MM = 5000.0, 2.0  # of a goal; smaller ones are hinted to be mm
LITTLE_MM = 0.5  # a motion below is told


@dataclass(frozen=True)
class Goal:
    """Where to go.

    Attributes:
        kind: of `GOALS`, or ``list``.
        values: deg for ``q`` (absolute) and ``turn`` (relative); mm for ``to`` (the tool's position in the base frame),
            ``by`` (relative, along the axes of the base frame) and ``along`` (relative, along those of the tool).
        line: whether the tool moves on a straight line.
        poses: list of poses, for ``list``.
        name: of the entry in it.
    """

    kind: str
    values: tuple[float, ...] = ()
    line: bool = False
    poses: Path | None = None
    name: str | None = None


def read_goal(given: Mapping[str, str | None], poses: Path | None, name: str | None, line: bool) -> Goal:
    """Return the goal from the options of the command.

    Args:
        given: texts of the options that `GOALS` names.
        poses: list of poses.
        name: of its entry.
        line: whether the tool moves on a straight line.

    Raises:
        InputError: there is not exactly one goal, or it is wrong.
    """
    chosen = [kind for kind, text in given.items() if text is not None] + (
        ["list"] if poses is not None else []
    )
    if not chosen and name is not None:
        raise InputError("move: --name names an entry of a list; give --list LIST too", option="--name")
    if len(chosen) != 1:
        options = ", ".join(f"--{kind}" for kind in (*GOALS, "list"))
        found = ", ".join(f"--{kind}" for kind in chosen) or "none"
        raise InputError(f"move: give one goal of {options}; given: {found}", given=chosen)
    kind = chosen[0]
    if (name is None) != (kind != "list"):
        raise InputError("move: --list LIST and --name NAME go together", option="--name")
    if line and kind not in TOOL:
        raise InputError("--line needs a tool position: --to, --by or --along", option="--line")
    if kind == "list":
        return Goal(kind, poses=poses, name=name)
    text = given[kind] or ""
    what = "J1 to J6 in deg" if GOALS[kind] == 6 else "x, y, z in mm"
    return Goal(kind, tuple(option_numbers(f"--{kind}", text, GOALS[kind], what).tolist()), line)


def goal_entry(goal: Goal, cell: Cell, q: Array) -> dict[str, Any]:
    """Return a goal that is no entry of a list as one, for an arm at `q` (6,) rad."""
    values = np.array(goal.values)
    if goal.kind in ("q", "turn"):
        q_deg = values if goal.kind == "q" else np.degrees(q) + values
        if rule := cell.unit.beyond_limits(np.radians(q_deg)):
            joint, _, must = rule.partition(" ")
            if goal.kind == "turn":
                reached = q_deg[cell.robot().joint_names.index(joint)]
                rule = f"{joint} would be at {reached:.1f} deg, {must}"
            raise InputError(f"{_option(goal)}: {rule}", option=f"--{goal.kind}", value=list(goal.values))
        return {"name": NAME, "q_deg": q_deg.tolist()}
    T = cell.robot().T_base_tool(q).copy()
    if goal.kind == "to":
        T[:3, 3] = 1e-3 * values
    else:
        T[:3, 3] += 1e-3 * (values if goal.kind == "by" else mul(T[:3, :3], values))
    if (far := np.abs(1e3 * T[:3, 3])).max() > FARTHEST_MM:
        why = f"{_option(goal)}: leads the tool {far.max():.0f} mm from the base; must be within {FARTHEST_MM:g} mm"
        raise InputError(why, option=f"--{goal.kind}", value=list(goal.values))
    return {"name": NAME, "T_base_tool": T.tolist(), **({"by": "line"} if goal.line else {})}


def move_step(
    goal: Goal,
    place: Path,
    port: str | None,
    look: Path | None,
    speed: float | None,
    unseen: bool,
    console: Console,
) -> dict[str, Any]:
    """Plan a motion from where the arm is to a goal, write its preview, ask for its code, and execute it.

    Args:
        goal: where to go.
        place, port, look, speed, unseen, console: see `cell.commands.manual.park.park_step`.

    Raises:
        InputError: a file, value or port is wrong, or the code was not typed; nothing moved.
        ImpossibleError: the unit was not homed, the arm may not move, or there is no certified motion; nothing moved.
        ExecutionStopped: motion stopped; the state is in the error's data.
    """
    task = read_place(place)
    cell, low = task.cell, manual_speed(task.cell, speed)
    if goal.kind == "q" and (doubt := doubt_of_deg(np.radians(goal.values), cell.unit)):
        console.say(f"NOTE: --q {doubt}")
    if goal.kind in ("by", "along") and (most := max(map(abs, goal.values))) < LITTLE_MM:
        console.say(f"NOTE: {_option(goal)}: the numbers are mm: the tool moves by at most {most:g} mm")
    if goal.kind == "turn" and (doubt := doubt_of_turn(goal.values)):
        console.say(f"NOTE: {_option(goal)}: {doubt}")
    if goal.kind in ("q", "to"):
        goal_entry(goal, cell, cell.q_start)  # refuses a goal beyond the limits before the port is opened
    listed = None if goal.poses is None else _entry_of(goal.poses, goal.name or "")
    if (
        listed is not None
        and (q := listed.entries[0].q) is not None
        and (doubt := doubt_of_deg(q, cell.unit))
    ):
        console.say(f"NOTE: {listed.file}: {goal.name!r} {doubt}")
    require_person(unseen, UNSEEN, "that the arm may move", port)
    plans: list[Plan] = []
    for line in () if listed is None else taught_otherwise(listed, cell):
        console.say(line)

    def plan_and_ask(run: TaskRun) -> None:
        q, around = q_now(run), scene_now(run, look)
        poses, file = listed, run.folder / POSES
        if poses is None:
            write_atomic(file, json.dumps({"entries": [goal_entry(goal, cell, q)]}) + "\n")
            poses = read_pose_list(file)
        here = replace(place_of_cell(task, None, low), scene=around, q_start=q)
        with explaining_zone(run, look), console.doing("planning"):
            try:
                plans.append(plan_pose_list(here, poses, back=False))
            except ImpossibleError as error:
                if listed is not None:
                    raise
                raise ImpossibleError(_typed(file, goal, str(error)), **error.data) from error
            erring_clearances(cell, plans[0], jaws_unknown=around.robot_open.digest != cell.robot().digest)
        require_seen(run, plans[0], unseen)

    with beside(task, port, console, "move", low, plan_and_ask, look=look) as run:
        home_or_check(run.connection.mars, cell, console, True, jaws_too=False)
        run.homed = True
        run.follow_through(plans[0])
        return arrive(run, run.report())


def _option(goal: Goal) -> str:
    """Return a goal as the user typed it."""
    return f"--{goal.kind}={','.join(f'{v:g}' for v in goal.values)}"


def _typed(file: Path, goal: Goal, text: str) -> str:
    """Return a message about the list of a goal with what the user typed in place of the list."""
    small = goal.kind in TOOL and max(map(abs, goal.values)) < FEW_MM
    given = f"{_option(goal)}{' (in mm: were metres meant?)' if small else ''}"
    return text.replace(f"{file}: entries[0]", given).replace(f"target {NAME!r}", "the goal")


def _entry_of(file: Path, name: str) -> PoseList:
    """The entry of a list as a list of its own: the pose alone, without what is done there.

    Raises:
        FileInputError: the list is wrong, or has no pose of that name.
    """
    listed = read_pose_list(file, Reading("tool", "deg"))
    found = [e for e in listed.entries if e.name == name and (e.q is not None or e.T is not None)]
    if not found:
        names = ", ".join(repr(e.name) for e in listed.entries if e.q is not None or e.T is not None)
        raise FileInputError(file, "name", name, f"is no pose of the list; must be one of {names}")
    return PoseList(file, (replace(found[0], jaws=None, dwell_s=0.0, retract=0.0, within=0.0),))
