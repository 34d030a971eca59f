"""Check that a plan handles the parts of its program: in order, where the program says, touching nothing else.

The rest of a stopped plan states in ``task.parts_before`` how many parts were taken and put down before it; its scene
has them where they were put. A part that the jaws hold then is attached before the first move.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.numerics.products import mul, norm
from arm.plan_file import GripperStep, Move, Pause, Plan, Step, touching_pairs
from arm.robot.model import Robot
from arm.se3 import Array, angle_between, inverse
from cell.program.parts.handled import Handled, Part, Parts
from plan.scene import Scene

PLACED = 5e-4  # permitted distance of the tool from where it takes or puts a part, m; rounding to counts causes 0.03 mm
TURNED = np.radians(0.2)  # the same of its rotation, rad


def scene_of_parts(
    now: Scene, stated: Scene, plan: Plan, part: Part, parts: Parts, T_base_tool: Array
) -> Scene:
    """Return the scene of now with the parts that were handled before a plan where the plan has them.

    Args:
        now: of the program, before it begins.
        stated: of the plan.
        plan: the plan.
        part, parts: of the program.
        T_base_tool: the tool at the beginning of the plan.

    Raises:
        ImpossibleError: the plan has one of them elsewhere than the program puts it; data: part, off_m.
    """
    before = parts.handled[: plan.task.get("parts_before", 0)]
    last = {one.part: one for one in before}
    cubes = {cube.name: cube for cube in stated.cubes}
    for one in last.values():
        if one.part not in cubes:
            raise _refused(f"its scene does not have {one.part}", part=one.part)
        T = cubes[one.part].T_base_body
        if not one.put:
            T = mul(mul(one.T_base_tool[0], inverse(T_base_tool)), T)
        off, turned = _nearest([mul(one.T_base_part, turn) for turn in part.turns()], T)
        if off > PLACED or turned > TURNED:
            where = "in the jaws" if not one.put else f"at {one.target!r}"
            why = f"it has {one.part} {1e3 * off:.1f} mm and {np.degrees(turned):.2f} deg from where that is {where}"
            raise _refused(why, part=one.part, off_m=off)
    put = {one.part for one in last.values() if one.put}
    left = (tuple(name for name in supply if name not in put) for supply in now.supplies)
    moved = now.with_moved({name: cubes[name].T_base_body for name in last})
    return replace(moved, supplies=tuple(supply for supply in left if supply))


def begins_at(plan: Plan, unit: Unit, q: Array) -> bool:
    """Whether the arm at q (n,) rad is at rest where a plan begins, as closely as `execute` asks for it."""
    return bool(np.abs(np.subtract(plan.start, unit.counts(q))).max() <= unit.rest_tolerance)


def require_parts(plan: Plan, parts: Parts, robot: Robot, unit: Unit, q_start: Array) -> None:
    """Require that a plan takes and puts down the parts of its program, each where and when the program does.

    Args:
        plan: the plan.
        parts: of the program.
        robot, unit: the arm.
        q_start: where a plan of the whole program begins, (n,) rad.

    Raises:
        ImpossibleError: it does not, or lets parts touch something elsewhere; data: step, part.
    """
    before = plan.task.get("parts_before", 0)
    if before > len(parts.handled) or (before > 0 and begins_at(plan, unit, q_start)):
        why = f"it states {before} parts taken or put down before its first move, where the arm has done none"
        raise _refused(why, stated=before)
    done, held = before, None
    if before > 0 and not parts.handled[before - 1].put:
        held = parts.handled[before - 1].part  # in the jaws already
    names, T_base_tool = {body.name for body in parts.bodies}, robot.T_base_tool(unit.positions(plan.start))
    last: GripperStep | None = None
    for index, step in enumerate(plan.steps):
        match step:
            case Move():
                if held is not None:
                    raise _refused(f"it does not state {held} in the jaws, which took it before", part=held)
                _require_touching(step, _beside(plan.steps, index, parts.handled, done), names)
                T_base_tool, last = robot.T_base_tool(unit.positions(step.path.end)), None
            case GripperStep():
                last = step
            case Pause(attached=str()) if held is not None and step.attached == held:
                held = None
            case Pause() if _handles(step):
                if done == len(parts.handled):
                    raise _refused(
                        f"{step.name!r} handles {step.attached or step.detached} after all", step=step.name
                    )
                _require_handles(step, parts.handled[done], last, T_base_tool)
                done += 1
    if done < len(parts.handled):
        one = parts.handled[done]
        verb = "put down" if one.put else "take"
        raise _refused(f"it does not {verb} {one.part} at {one.target!r}", part=one.part)


def _beside(steps: Sequence[Step], index: int, handled: Sequence[Handled], done: int) -> Handled | None:
    """Return what is handled at the end of the line of a step, or at its beginning; None if nothing is.

    Args:
        steps, index: of the plan, and of the line.
        handled: of the program.
        done: how many of them are handled before the step.
    """
    role = getattr(steps[index], "role", "")
    if role == "approach" and done < len(handled):
        after = steps[index + 1 : index + 3]
        return (
            handled[done] if [type(s) for s in after] == [GripperStep, Pause] and _handles(after[1]) else None
        )
    if role == "retract" and done > 0:
        # the rest of a stopped plan may begin on such a line, or with the jaws as they were
        begins = not any(isinstance(s, Move) for s in steps[:index])
        return handled[done - 1] if begins or _handles(steps[index - 1]) else None
    return None


def _handles(step: Step) -> bool:
    return isinstance(step, Pause) and (step.attached is not None or step.detached is not None)


def _require_touching(move: Move, one: Handled | None, names: set[str]) -> None:
    """Require that the parts that may touch on a move do so on the lines to and from where one is handled."""
    touching = {pair for pair in touching_pairs(move) if pair & names}
    permitted = frozenset() if one is None else one.touch
    for pair in sorted(touching - permitted, key=sorted):
        raise _refused(
            f"{move.name!r} lets touch {' and '.join(sorted(pair))}, which must not there", step=move.name
        )


def _require_handles(step: Pause, one: Handled, jaws: GripperStep | None, T_base_tool: Array) -> None:
    """Require that a step takes or puts down a part as the program does, at its pose, with the jaws."""
    stated = step.attached, step.detached
    if stated != ((None, one.part) if one.put else (one.part, None)):
        verb = "put down" if one.put else "taken"
        raise _refused(f"{step.name!r} is where {one.part} must be {verb}", step=step.name, part=one.part)
    action = "open" if one.put else "close"
    if jaws is None or jaws.action != action:
        raise _refused(f"the jaws do not {action} at {step.name!r}", step=step.name, part=one.part)
    off, turned = _nearest(one.T_base_tool, T_base_tool)
    if off > PLACED or turned > TURNED:
        why = f"the tool is {1e3 * off:.1f} mm and {np.degrees(turned):.2f} deg from where {step.name!r} is"
        raise _refused(why, step=step.name, part=one.part, off_m=off)


def _nearest(poses: Iterable[Array], T: Array) -> tuple[float, float]:
    """Return distance, m, and angle, rad, of a pose from the nearest one of several."""
    found = ((norm(one[:3, 3] - T[:3, 3]), angle_between(one[:3, :3], T[:3, :3])) for one in poses)
    return min(found, key=lambda off: max(off[0] / PLACED, off[1] / TURNED))


def _refused(why: str, **data: object) -> ImpossibleError:
    return ImpossibleError(
        f"the plan does not handle the parts as its program does: {why}; plan again", **data
    )
