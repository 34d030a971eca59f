"""Plan a program file: its goals among the bodies of the cell and of the workpiece."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from arm.errors import FileInputError, ImpossibleError, InputError
from arm.numerics.products import mul
from arm.plan_file import Plan, touching_pairs
from arm.robot.thread import Thread
from arm.se3 import Array, apply, frozen
from cell.program.doubts.hints import hint
from cell.program.parts.handled import Handled, Parts, parts_of, standing_on
from cell.program.parts.plan_check import begins_at, require_parts, scene_of_parts
from cell.program.path_speeds import with_kept_speeds
from cell.program.path_step import PathStep
from cell.program.program_file import PROGRAM, ProgramTask
from cell.program.steps import Action, JointStep, PoseStep, Step, name_of
from cell.scene.build import build_scene
from cell.scene.fingerprint import plan_fingerprint
from cell.scene.options import options_of
from plan.advice.changes import Request
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.program import Program, plan_program
from plan.scene import Scene
from vision.observation import Observation

LEAST_DWELL_S = 1e-3  # at rest, so that the arm stops for its jaws
_START = "start"


def T_base_work(task: ProgramTask, observation: Observation) -> Array:
    """Return where the workpiece is: as the file says, or on the board that was seen.

    Raises:
        ImpossibleError: the board was not found.
    """
    if task.board is None:
        return task.T_on_work
    seen = observation.board(task.board.name)
    if seen is None:
        none = "" if observation.boards or observation.missing else "; give a look of it with --look FILE"
        why = f"board {task.board.name}, on which the workpiece is, was not found{none}"
        raise ImpossibleError(why, board=task.board.name)
    return frozen(mul(seen.pose.T_base_board, task.T_on_work))


def program_scene(task: ProgramTask, observation: Observation) -> Scene:
    """Return the bodies of the cell, of the boards that were seen, and of the workpiece, and the parts.

    A workpiece on a board may move with it, unnoticed by `look.moved_mm`, so its bodies and parts are padded by that.

    Raises:
        ImpossibleError: see `T_base_work` and `cell.program.parts.handled.standing_on`.
    """
    return _surroundings(task, observation)[0]


def program_parts(task: ProgramTask, observation: Observation) -> Parts:
    """Return what the program takes and puts down; raises as `program_scene`."""
    return _surroundings(task, observation)[1]


def _surroundings(task: ProgramTask, observation: Observation) -> tuple[Scene, Parts]:
    scene = build_scene(task.cell, observation)
    padding = 0.0 if task.board is None else task.cell.moved
    T = T_base_work(task, observation)
    padded = tuple(replace(body, padding=padding) for body in task.bodies_at(T))
    bodies = (*scene.bodies, *padded)
    alone = parts_of(task.part, task.steps, task.repeat, T, padding)
    parts = standing_on(alone, bodies, task.required)
    scene = replace(
        scene,
        bodies=bodies,
        cubes=(*scene.cubes, *parts.bodies),
        supplies=parts.supplies,
        allowed=scene.allowed | task.touch | parts.touch,
        threads=tuple(Thread(line.name, line.ring, apply(T, line.points)) for line in task.threads),
    )
    return scene, parts


def program_options(task: ProgramTask, speed: float) -> PlanOptions:
    """Planner options for a program: all motions keep its clearance, and the arm never looks."""
    clearance = task.required
    return replace(options_of(task, speed), clearance=clearance, line_clearance=clearance, look="never")


def plan_of_program(
    task: ProgramTask,
    observation: Observation,
    speed: float,
    explain: Callable[[Request, ImpossibleError], None] | None = None,
) -> Plan:
    """Plan from rest at q_start through all steps, to the configuration at the end.

    Args:
        task: the program.
        observation: boards that were seen; none if nothing was looked at.
        speed: see `cell.session.speed`.
        explain: called with what could not be planned, and the error, before that is raised.

    Raises:
        InputError: a value that `plan.program.goals.target.Target` refuses; names the step.
        ImpossibleError: a step (named) is out of reach or too near to a body, or there is no clear path.
    """
    cell, T = task.cell, T_base_work(task, observation)
    try:
        scene, parts = _surroundings(task, observation)
    except ImpossibleError as error:
        raise _located(task, error) from error
    goals = tuple(program_goals(task, T, parts))
    options = program_options(task, speed)
    provenance = plan_fingerprint(task)
    stated = {"name": task.name, "kind": PROGRAM, "title": task.title, "repeat": task.repeat}
    if task.board is not None:
        stated["board"] = task.board.name
    program = Program(
        scene, goals, cell.q_start, cell.unit, cell.limits, options, provenance=provenance, task=stated
    )
    try:
        found, kept = with_kept_speeds(
            task, goals, lambda some: plan_program(replace(program, goals=tuple(some)))
        )
    except ImpossibleError as error:
        if explain is not None:
            asked = scene, (), cell.q_start, cell.unit, cell.limits, options
            explain(Request(*asked, goals=goals), error)
        raise _located(task, error) from error
    reached = [{"name": r.target, "q": [round(float(v), 9) + 0.0 for v in r.q]} for r in found.reached]
    if kept:
        stated["kept_speeds"] = [one.to_json() for one in kept]
    return replace(found, task={**stated, "reached": reached}).plan()


def scene_of_plan(task: ProgramTask, plan: Plan, stated: Scene, seen: Observation) -> Scene:
    """Return the scene of the program with the boards of a plan, and with the parts that were handled before it.

    Args:
        task: the program.
        plan: a plan of it, or the rest of one.
        stated: the plan's own scene.
        seen: the boards of that scene.

    Raises:
        ImpossibleError: see `program_scene`, `cell.program.parts.plan_check.require_parts` and `scene_of_parts` there.
    """
    scene, parts = _surroundings(task, seen)
    if task.part is None:
        return scene
    cell, robot = task.cell, task.cell.robot()
    require_parts(plan, parts, robot, cell.unit, cell.q_start)
    T_base_tool = robot.T_base_tool(cell.unit.positions(plan.start))
    return scene_of_parts(scene, stated, plan, task.part, parts, T_base_tool)


def require_board(task: ProgramTask, plan: Plan) -> None:
    """Require that a plan states the board of the program's work: the errors of the workpiece are those of that board.

    Raises:
        ImpossibleError: it does not; data: stated, expected.
    """
    stated, expected = plan.task.get("board"), None if task.board is None else task.board.name
    if stated != expected:
        shown, asked = ("no board" if name is None else f"board {name}" for name in (stated, expected))
        why = (
            f"the plan is for a workpiece on {shown}, but that of {task.file.name} is on {asked}; plan again"
        )
        raise ImpossibleError(why, stated=stated, expected=expected)


def require_threads(task: ProgramTask, plan: Plan) -> None:
    """Require that a plan states `threaded` for as many moves, in order, as the paths of the program have.

    A move that does not state it is not proved to stay on its wire, nor one in which ring and wire may touch. Only the
    rest of a stopped plan may have fewer, and it does not begin at q_start.

    Raises:
        ImpossibleError: it does not; data: stated, expected.
    """
    goals = [goal for goal in program_goals(task, np.eye(4)) if goal.threaded is not None]
    goals = [goal for goal in goals for _ in range(1 + goal.back)]
    before = plan.task.get("threaded_before", 0)  # of a plan for the rest of another
    if before > len(goals) or (before > 0 and begins_at(plan, task.cell.unit, task.cell.q_start)):
        why = f"the plan states {before} threaded moves before its first one, where the arm has done none; plan again"
        raise ImpossibleError(why, stated=before, expected=[goal.threaded for goal in goals])
    goals = goals[before:]
    moves = [move for move in plan.moves if move.threaded is not None]
    stated, expected = [move.threaded for move in moves], [goal.threaded for goal in goals]
    if stated != expected:
        shown, asked = (", ".join(filter(None, names)) or "none" for names in (stated, expected))
        why = (
            f"the plan states a threaded ring for moves on {shown}; the program asks for {asked}; plan again"
        )
        raise ImpossibleError(why, stated=stated, expected=expected)
    for move, goal in zip(moves, goals, strict=True):
        more = sorted(" and ".join(sorted(pair)) for pair in touching_pairs(move) - goal.pairs)
        if more:
            why = f"{move.name!r} lets touch {', '.join(more)}, which the program does not allow there; plan again"
            raise ImpossibleError(why, step=move.name, touching=more)


def program_goals(task: ProgramTask, T_base_work: Array, parts: Parts | None = None) -> Iterator[Target]:
    """Yield the targets of all repeats, and the configuration at the end; without `parts` they handle none."""
    before: Target | None = None
    for repeat in range(task.repeat):
        for step in task.steps:
            if isinstance(step, Action):
                before = _acting(task, step, before)
                continue
            if before is not None:
                yield before
            *legs, before = _targets(task, step, repeat, T_base_work)
            handled = None if parts is None else parts.at(before.name)
            before = before if handled is None else _handling(before, handled)
            yield from legs
    if before is not None:
        yield before
    yield Target("end", q=task.q_end, role="home")


def _acting(task: ProgramTask, action: Action, at: Target | None) -> Target:
    """Return a target with an action there; the start if there is none before it."""
    at = at or Target(_START, q=task.cell.q_start)
    if action.jaws is None:
        return replace(at, dwell_s=at.dwell_s + action.dwell_s)
    return replace(
        at,
        jaws=action.jaws,
        settle_s=task.cell.settle_s,
        dwell_s=max(action.dwell_s, LEAST_DWELL_S),
    )


def _targets(task: ProgramTask, step: Step, repeat: int, T_base_work: Array) -> list[Target]:
    """Return the targets of a step that moves, in order."""
    name = name_of(step, repeat)
    try:
        match step:
            case JointStep():
                return [Target(name, q=step.q)]
            case PoseStep():
                return [
                    _at_pose(step, name, mul(T_base_work, step.T_work_tool[repeat % len(step.T_work_tool)]))
                ]
            case PathStep():
                return _along(step, name, T_base_work)
    except InputError as error:
        raise FileInputError(task.file, step.key, None, str(error)) from error
    return []


def _at_pose(step: PoseStep, name: str, T_base_tool: Array) -> Target:
    return Target(
        name,
        T_base_tool,
        free=step.free,
        tilt=step.tilt,
        ranges=step.ranges,
        by=step.by,
        approach=step.approach,
        retract=step.retract,
        speed=step.speed,
        blend_radius=step.within,
        allowed_collisions=step.touch,
    )


def _handling(target: Target, handled: Handled) -> Target:
    """Return the target that takes a part, or puts it down, with the turns at which the jaws may hold it."""
    return replace(
        target,
        T_base_tool=handled.T_base_tool,
        free="",
        attach=None if handled.put else handled.part,
        detach=handled.put,
        allowed_collisions=target.pairs | handled.touch,
    )


def _along(step: PathStep, name: str, T_base_work: Array) -> list[Target]:
    """Return a target for each leg of a path between corners at which the arm stops, and for those of the way back."""
    legs = [mul(T_base_work, leg) for leg in step.legs()]
    at_once = step.back and len(legs) == 1
    if step.back and not at_once:
        legs += [leg[::-1] for leg in reversed(legs)]
    return [
        Target(
            name if number == 1 else f"{name}, leg {number}",
            frozen(leg),
            free=step.free,
            tilt=step.tilt,
            ranges=step.ranges,
            by="path",
            back=at_once,
            speed=step.speed,
            allowed_collisions=step.touch,
            clearance_of=step.clearance_of,
            threaded=None if step.threaded is None else step.threaded.name,
        )
        for number, leg in enumerate(legs, start=1)
    ]


def _located(task: ProgramTask, error: ImpossibleError) -> ImpossibleError:
    """Return the error with the file and, if it names a target, its step."""
    target = str(error.data.get("target", ""))
    # an action has the name of the motion before it, which is meant
    names = {name_of(step, repeat): step for repeat in range(task.repeat) for step in reversed(task.steps)}
    step = next((names[name] for name in (target, target.partition(", leg ")[0]) if name in names), None)
    key = "" if step is None else step.key
    data = {k: v for k, v in error.data.items() if k != "step"}
    why = f"{task.file}: {f'{key}: ' if key else ''}{error}{hint(task, step, error)}"
    return ImpossibleError(why, step=key, **data)
