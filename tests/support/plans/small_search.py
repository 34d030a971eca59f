"""Small tasks and their searches."""

from __future__ import annotations

from dataclasses import replace

from arm.controller.unit import load_unit
from plan.options import PlanOptions
from plan.program.assignment.planner import AssignmentPlanner, Transfers
from plan.program.assignment.search import TaskSearch
from plan.program.setting import Setting
from tasks.task2 import Q_START, WALL, Task2, task2

UNIT = load_unit("crs93")

OPTIONS = PlanOptions(look="never", certificate="decide")

CASES = {
    "plain": (task2(cubes=2), OPTIONS),
    "wall": (task2([WALL], cubes=2), OPTIONS),
    "looks": (task2(cubes=2), replace(OPTIONS, look="each")),
}


def planner_of(case: Task2, options: PlanOptions) -> AssignmentPlanner:
    setting = Setting(case.scene, UNIT, UNIT.limits(), options)
    return AssignmentPlanner(setting, Transfers(tuple(case.transfers)), setting.at_counts("q_start", Q_START))


def search_of(case: Task2, options: PlanOptions) -> TaskSearch:
    return planner_of(case, options).search()
