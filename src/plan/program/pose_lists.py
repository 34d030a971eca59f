"""A list of poses for any arm, as a program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy.typing as npt

from arm.arguments import joints, shown
from arm.controller.unit import Limits, Unit
from arm.errors import InputError
from arm.robot.model import Robot
from arm.robot.shapes import Body
from plan.budget import SearchBudget
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.program import Program, plan_program
from plan.program.sequence.planner import SearchEffort
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit

Q_END = "q_end"  # name of the last goal


def plan_poses(
    robot: Robot,
    bodies: Sequence[Body],
    targets: Sequence[Target],
    q_start: npt.ArrayLike,
    limits: Limits,
    *,
    q_end: npt.ArrayLike | None = None,
    unit: Unit | None = None,
    options: PlanOptions | None = None,
    effort: SearchEffort | None = None,
    padding: float = 0.0,
    budget: SearchBudget | None = None,
) -> Planned:
    """Plan a motion of the tool through a list of poses, from rest at `q_start`.

    Args:
        robot: any arm with its tool; `arm.robot.tool` changes the tool, or disables collisions between neighbours.
        bodies: obstacles, and bodies to attach.
        targets: in order; see `Target`. The first is reached by a transit, whatever its `by`.
        q_start: (n,) rad (m for prismatic joints).
        limits: joint limits at speed 1.
        q_end: configuration at the end, reached by a transit; default: that at the last target.
        unit: a controller's counts; default: counts of 1 urad (`plan.trajectory.virtual_unit`).
        options: speeds, clearances, seed, certificate; options of cubes, jaws and looks are ignored.
        effort: limits on the search, as numbers of attempts.
        padding: subtracted from every distance, m.
        budget: limit on the effort of the whole search.

    Raises:
        InputError: no targets, repeated or unknown names, a start or end outside limits.
        ImpossibleError, PlanningInterrupted: see `plan.program.sequence.planner.SequencePlanner.planned`.
    """
    wrong = [thing for thing in bodies if not isinstance(thing, Body)]
    if wrong:
        raise InputError(f"bodies: {shown(wrong[0])}: must be a Body", value=shown(wrong[0]))
    goals = [
        *targets,
        *([] if q_end is None else [Target(Q_END, q=joints("q_end", q_end, robot.joint_names))]),
    ]
    if not targets:
        raise InputError("a list of poses needs at least one target", targets=0)
    carried = {target.attach for target in targets if isinstance(target, Target)}
    fixed, loose = (tuple(b for b in bodies if (b.name in carried) is moved) for moved in (False, True))
    program = Program(
        Scene(robot, robot, fixed, loose),
        tuple(goals),
        q_start,
        unit or virtual_unit(robot, limits),
        limits,
        options or PlanOptions(),
        padding=padding,
    )
    found = plan_program(program, effort, budget)
    return replace(found, reached=tuple(r for r in found.reached if r.target != Q_END))
