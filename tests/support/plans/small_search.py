"""Small tasks and their searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm.controller.unit import load_unit
from plan.options import PlanOptions
from plan.program.assignment.search import TaskSearch
from plan.program.tasks import Planner
from tasks.task2 import Q_START, WALL, Task2, task2

UNIT = load_unit("crs93")

OPTIONS = PlanOptions(look="never", certificate="decide")

CASES = {
    "plain": (task2(cubes=2), OPTIONS),
    "wall": (task2([WALL], cubes=2), OPTIONS),
    "looks": (task2(cubes=2), replace(OPTIONS, look="each")),
}


def search_of(case: Task2, options: PlanOptions) -> TaskSearch:
    planner = Planner(case.scene, np.array(Q_START), UNIT, UNIT.limits(), options)
    return planner.search(case.transfers, ())
