"""Programs of goals, the input of the planner: tasks, lists of poses and single motions are programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import groupby
from typing import Any

import numpy.typing as npt

from arm.arguments import shown
from arm.controller.unit import Limits, Unit
from arm.errors import InputError
from plan.budget import Meter, PlanningInterrupted, SearchBudget, allowed
from plan.options import PlanOptions
from plan.program.aim import clearest
from plan.program.assignment.planner import AssignmentPlanner, Transfers
from plan.program.goals.attachments import AttachmentState
from plan.program.goals.target import Target
from plan.program.planned import Planned, joined
from plan.program.sequence.planner import SearchEffort, SequencePlanner
from plan.program.setting import Setting
from plan.scene import Scene


@dataclass(frozen=True, eq=False)
class Program:
    """Goals for an arm among bodies.

    Goals are reached in the order of the list. A `Transfers` goal moves several cubes; their order, places and grasps
    are chosen together, as the options allow.

    Attributes:
        scene: the arm with open and with closed jaws, bodies and cubes.
        goals: at least one `Target` or `Transfers`. The first target is reached by a transit, whatever its `by`.
        q_start: present configuration of the arm, at rest, (n,) rad (m for prismatic joints).
        unit: the arm's counts and registers.
        limits: joint limits at speed 1; default: those of the unit's default registers.
        options: speeds, clearances, and which choices are free.
        state: the attached body at the start; default: none.
        padding: subtracted from every distance, m; 0 with transfers, whose bodies have their own padding.
        provenance: other inputs of the plan (calibration, files), as JSON types. Its key `notes` becomes the plan's
            notes.
        task: name and kind of the task, for the plan file; JSON types.

    Raises:
        InputError: a value of another type, or a padding with transfers.
    """

    scene: Scene
    goals: tuple[Target | Transfers, ...]
    q_start: npt.ArrayLike
    unit: Unit
    limits: Limits | None = None
    options: PlanOptions = field(default_factory=PlanOptions)
    state: AttachmentState | None = None
    padding: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    task: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, kind in (
            ("scene", Scene),
            ("goals", tuple | list),
            ("unit", Unit),
            ("limits", Limits | None),
            ("options", PlanOptions),
            ("state", AttachmentState | None),
        ):
            if not isinstance(getattr(self, name), kind):
                of = getattr(kind, "__name__", str(kind))
                raise InputError(f"{name} = {shown(getattr(self, name))}: must be a {of}", name=name)
        if self.padding and any(isinstance(goal, Transfers) for goal in self.goals):
            why = f"padding = {shown(self.padding)} m: must be 0 with transfers; give bodies and arm their own padding"
            raise InputError(why, name="padding")


def plan_program(
    program: Program, effort: SearchEffort | None = None, budget: SearchBudget | None = None
) -> Planned:
    """Plan a program. Each move of the plan is certified after timing and rounding to counts.

    Args:
        program: the program.
        effort: limits on the search over goals in a given order, as numbers of attempts.
        budget: limit on the effort of the whole search. When it is spent, the best complete plan is returned; its
            `stopped` says so.

    Raises:
        InputError: no goals, unknown or repeated names, a configuration beyond limits.
        ImpossibleError: a goal is out of reach, or no collision-free path was found; data: `failure`. Or the budget was
            spent before a plan was complete; data: `budget`.
        PlanningInterrupted: Ctrl-C was pressed; carries the best complete plan, if there is one.
    """
    with allowed(budget) as meter:
        paths = any(isinstance(goal, Target) and goal.by == "path" for goal in program.goals)
        if program.options.aim == "time" or paths:  # paths are widened themselves
            return _planned(program, program.options, effort, meter)
        limits = program.limits or program.unit.limits()
        # every plan states the required clearance; its moves state their larger certified ones
        required = Setting(program.scene, program.unit, limits, program.options)
        return clearest(
            lambda options: replace(_planned(program, options, effort, meter), setting=required),
            program.options,
        )


def _planned(program: Program, options: PlanOptions, effort: SearchEffort | None, meter: Meter) -> Planned:
    """Plan a program for the least time, with these options."""
    limits = program.limits or program.unit.limits()
    setting = Setting(program.scene, program.unit, limits, options)
    blocks = list(_blocks(program.goals))
    parts: list[Planned] = []
    for goals in blocks:
        part = _part(program, setting, goals, parts, effort, meter)
        parts.append(replace(part, provenance=program.provenance, task=program.task))
        if part.interrupted:
            complete = len(parts) == len(blocks)
            raise PlanningInterrupted(part.stopped, reduce(joined, parts).plan() if complete else None)
    return reduce(joined, parts)


def _blocks(goals: Sequence[Target | Transfers]) -> Iterator[Transfers | list[Target]]:
    """Yield each `Transfers` alone, and consecutive targets together."""
    wrong = [goal for goal in goals if not isinstance(goal, Target | Transfers)]
    if wrong or not goals:
        why = f"goals: {shown(wrong[0]) if wrong else 'none'}: must be at least one Target or Transfers"
        raise InputError(why, goals=len(goals))
    for several, group in groupby(goals, key=lambda goal: isinstance(goal, Transfers)):
        if several:
            yield from (goal for goal in group if isinstance(goal, Transfers))
        else:
            yield [goal for goal in group if isinstance(goal, Target)]


def _part(
    program: Program,
    setting: Setting,
    goals: Transfers | list[Target],
    before: Sequence[Planned],
    effort: SearchEffort | None,
    meter: Meter,
) -> Planned:
    """Plan goals that follow other parts of the program."""
    q = before[-1].q_end if before else setting.at_counts("q_start", program.q_start)
    state = before[-1].state if before else program.state
    if not isinstance(goals, Transfers):
        return SequencePlanner(setting, goals, q, state, effort, program.padding).planned(meter)
    if state is not None and state.held is not None:
        raise InputError(f"{state.held} is attached where transfers begin; detach it first", held=state.held)
    first_cube = sum(len(part.cubes) for part in before)
    return AssignmentPlanner(setting, goals, q, state, first_cube).planned(meter)
