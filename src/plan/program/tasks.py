"""Tasks: cubes that are moved from place to place, as a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.plan_file import Plan
from plan.budget import SearchBudget
from plan.options import PlanOptions
from plan.program.assignment.planner import Transfers
from plan.program.program import Program, plan_program
from plan.scene import Scene, Station, Transfer


def plan_task(
    scene: Scene,
    transfers: Sequence[Transfer],
    q_start: npt.ArrayLike,
    unit: Unit,
    limits: Limits | None = None,
    options: PlanOptions | None = None,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
    places: Sequence[Station] = (),
    budget: SearchBudget | None = None,
    skip: bool = False,
) -> Plan:
    """Plan all transfers, from `q_start` back to `q_start`.

    Order, places, grasps and branches are chosen together for the least time (`plan.program.assignment.search`), unless
    the options give order or places. Reach of every place is checked first. The arm stops only where the gripper acts,
    at home and to look.

    Args:
        scene, q_start, unit, limits, options, provenance, task: see `plan.program.program.Program`.
        transfers, places, skip: see `plan.program.assignment.planner.Transfers`.
        budget: see `plan.program.program.plan_program`; if it ends the search, the plan's `notes["search"]` says so.

    Raises:
        InputError: no transfers, an unknown cube, or a start outside limits.
        ImpossibleError, PlanningInterrupted: see `plan.program.program.plan_program`. `plan.advice.search` finds
            changes that would help.
    """
    goals = (Transfers(tuple(transfers), tuple(places), skip),)
    program = Program(
        scene,
        goals,
        q_start,
        unit,
        limits,
        options or PlanOptions(),
        provenance=provenance or {},
        task=task or {},
    )
    return plan_program(program, budget=budget).plan()
