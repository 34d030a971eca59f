"""The rest of a plan that was stopped on its way: the same path of the joints, from where the arm is.

A motion is timed again from rest, over its own planned time, and never faster than planned: so tool speeds are kept.
Each of its moves is certified anew, in its own world. What follows the motion stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, takewhile

import numpy as np
from scipy.interpolate import CubicSpline

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.plan_file import GripperStep, Move, Pause, Plan, Step
from arm.se3 import Array, frozen
from plan.collision.certificate import certify_move
from plan.failure import nearness
from plan.motion.builder import rounded_down
from plan.program.setting import Setting
from plan.trajectory.integer_segments import to_marked_segments, to_segments
from plan.trajectory.rounding import vertex_jump
from plan.trajectory.timing import time_curve
from plan.verify import ON_LINES, MoveScene, before_steps, scenes_of_moves

NEAR = np.radians(0.5)  # of any joint; an arm this close to a move of the plan stopped there
SAME = 1e-3  # rad: places at distances that differ by less are equally near, and the first one counts
_STEP_S = 0.02  # between samples of the path
_JOIN_S = 0.2  # in which an arm that is beside its path comes back to it
_LEAST_S = 0.05  # of a move; a shorter rest of one is left out
_DEVIATION = 5e-5  # rad, of any joint from the path that is timed


@dataclass(frozen=True)
class Place:
    """Where an arm is on a plan.

    Attributes:
        step: index of the step.
        time_s: planned time since the beginning of that step, if it is a move, else 0.
        off: largest distance of a joint from there, rad.
    """

    step: int
    time_s: float
    off: float


def place_on(plan: Plan, unit: Unit, q: Array, stopped_in: int | None = None) -> Place:
    """Return the place of a plan that is nearest to q (n,) rad: the first one, if several are `NEAR`.

    Args:
        plan, unit: the plan and the unit of its counts.
        q: where the arm is.
        stopped_in: index of the step that ran when the arm was stopped, or the one before; None: not known.
    """
    among = range(len(plan.steps)) if stopped_in is None else (stopped_in, stopped_in + 1)
    found = [
        _nearest(unit, step, index, q)
        for index, step in enumerate(plan.steps)
        if index in among and isinstance(step, Move)
    ]
    if stopped_in is not None and not isinstance(plan.steps[stopped_in], Move):
        at = [step.path.end for step in plan.steps[:stopped_in] if isinstance(step, Move)]
        off = float(np.abs(unit.positions(at[-1] if at else plan.start) - q).max())
        found.insert(0, Place(stopped_in, 0.0, off))
    near = [place for place in found if place.off <= NEAR]
    least = min(place.off for place in near or found)
    return next(place for place in near or found if place.off <= least + SAME)


def _nearest(unit: Unit, move: Move, index: int, q: Array) -> Place:
    times = np.linspace(0.0, move.path.duration_s, 2 + int(move.path.duration_s / (0.25 * _STEP_S)))
    off = np.round(np.abs(unit.positions(move.path.at(times)) - q).max(axis=1), 9)
    best = int(np.argmin(off))
    return Place(index, float(times[best]), float(off[best]))


def rest_of_plan(plan: Plan, setting: Setting, place: Place, q: Array) -> Plan:
    """Return the plan from a place on, for an arm at rest at q (n,) rad.

    Raises:
        ImpossibleError: nothing is left, or the way back to the path cannot be certified; data: step, pair.
    """
    scenes = {id(of.move): of for of in scenes_of_moves(plan, setting.scene, setting.unit)}
    index, left = place.step, plan.steps[place.step :]
    if isinstance(left[0], Pause) and index > 0 and isinstance(plan.steps[index - 1], GripperStep):
        index, left = (
            index - 1,
            plan.steps[index - 1 :],
        )  # what is taken or put down there begins with the jaws
    moves = [step for step in takewhile(lambda step: isinstance(step, Move), left) if isinstance(step, Move)]
    begin = place.time_s
    while moves and moves[0].path.duration_s - begin < _LEAST_S:  # too short for a move
        index, moves, begin = index + 1, moves[1:], 0.0
    sent = _timed_again(setting, [scenes[id(move)] for move in moves], begin, q) if moves else ()
    steps = (*sent, *plan.steps[index + len(moves) :])
    if not any(isinstance(step, Move) for step in steps):
        raise ImpossibleError("nothing of the plan is left to do", step=place.step)
    done = sum(isinstance(step, Move) and step.threaded is not None for step in plan.steps[:index])
    task = {**plan.task, "threaded_before": plan.task.get("threaded_before", 0) + done}
    rest = replace(plan, steps=steps, task=task)
    return _with_supplied(plan, rest, index, setting) if setting.scene.supplies else rest


def handled_before(plan: Plan, index: int) -> int:
    """Return how many supplied cubes were taken or put down before a step, those before the plan included."""
    before = int(plan.task.get("parts_before", 0))
    steps = (step for step in plan.steps[:index] if isinstance(step, Pause))
    handled = sum(step.attached is not None or step.detached is not None for step in steps)
    again = before % 2 == 1 and handled > 0  # the rest of a plan attaches first what was taken before
    return before + handled - again


def _with_supplied(plan: Plan, rest: Plan, index: int, setting: Setting) -> Plan:
    """Return the rest of a plan from a step on, in a scene with the supplied cubes as they are then.

    It begins with the jaws as they are, unless they move first, and with the cube in them.
    """
    scene, unit = setting.scene, setting.unit
    before = next(islice(before_steps(plan, scene, unit), index, None))[1]
    moved, begin = {cube.name: cube.T_base_body for cube in before.resting}, list[Step]()
    jaws = [step for step in plan.steps[:index] if isinstance(step, GripperStep)][-1:]
    if not isinstance(plan.steps[index], GripperStep):
        begin += jaws
    if before.held is not None:
        cube, T_tool_held = before.held
        moved[cube.name] = frozen(mul(scene.robot_open.T_base_tool(unit.positions(rest.start)), T_tool_held))
        begin.append(Pause(f"{cube.name} in the jaws", 0.0, cube.name))
    put = {step.detached for step in plan.steps[:index] if isinstance(step, Pause)}
    left = (tuple(name for name in supply if name not in put) for supply in scene.supplies)
    scene = replace(scene.with_moved(moved), supplies=tuple(supply for supply in left if supply))
    return replace(
        rest,
        steps=(*begin, *rest.steps),
        task={**rest.task, "parts_before": handled_before(plan, index)},
        scene=scene.to_json(),
        provenance={**rest.provenance, "scene": scene.digest},
    )


def _timed_again(setting: Setting, scenes: Sequence[MoveScene], begin_s: float, q: Array) -> tuple[Move, ...]:
    """Return the moves of a motion, the first one from `begin_s` on, as they are sent from rest at q (n,) rad."""
    unit, options = setting.unit, setting.options
    times, places, marks = [], [], [0.0]
    for of, first in zip(scenes, (begin_s, *[0.0] * len(scenes)), strict=False):
        lasts = of.move.path.duration_s - first
        own = np.linspace(0.0, lasts, max(2, round(lasts / _STEP_S)) + 1)[1:]
        places.append(unit.positions(of.move.path.at(first + own)))
        times.append(marks[-1] + own)
        marks.append(marks[-1] + lasts)
    at, way = np.concatenate([[0.0], *times]), np.concatenate([q[None], *places])
    left = np.maximum(1.0 - at / _JOIN_S, 0.0)
    beside = q - unit.positions(scenes[0].move.path.at([begin_s]))[0]
    way[1:] += (left**2 * (3.0 - 2.0 * left))[1:, None] * beside
    path = CubicSpline(at, way, bc_type=("not-a-knot", "clamped"))
    timed = time_curve(path, setting.planned, 1.0, options.by_toppra)
    jump = vertex_jump(setting.sent.acceleration, options.speed)
    if len(scenes) == 1:
        whole = to_segments(
            timed, unit, options.segment_ms, limits=setting.sent, deviation=_DEVIATION, jump=jump
        )
        firsts = [0]
    else:
        marked = to_marked_segments(
            timed,
            unit,
            options.segment_ms,
            limits=setting.sent,
            marks=marks[1:-1],
            deviation=_DEVIATION,
            jump=jump,
        )
        whole, firsts = marked.path, [0, *marked.first]
    knots = whole.knots()
    return tuple(
        _certified(setting, of, CountPath(tuple(int(c) for c in knots[first]), whole.segments[first:last]))
        for of, first, last in zip(scenes, firsts, [*firsts[1:], len(whole.segments)], strict=True)
    )


def _certified(setting: Setting, of: MoveScene, path: CountPath) -> Move:
    options, move = setting.options, of.move
    required = options.line_clearance if move.role in ON_LINES else options.clearance
    check = certify_move(of.world(), path, setting.unit, required)
    if not check.proved:
        raise ImpossibleError(
            f"the rest of {move.name!r}: {nearness(check.pair, check.seen, required)}",
            step=move.name,
            pair=list(check.pair),
            distance_m=check.seen,
        )
    return replace(
        move,
        path=path,
        clearance=rounded_down(check.clearance),
        closest=check.pair,
        clearances=tuple(rounded_down(min(bound, check.seen)) for bound in check.bounds),
    )
