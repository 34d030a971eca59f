"""Small tasks and their searches."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from arm.controller.unit import load_unit
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, rot_x, rot_z, transform
from plan.options import PlanOptions
from plan.program.assignment.planner import AssignmentPlanner, Transfers
from plan.program.assignment.search import TaskSearch
from plan.program.setting import Setting
from plan.scene import Scene, Station, Transfer
from tasks.task2 import CUBE, JAW_OPENING, Q_START, TABLE, TOOL_LENGTH, WALL, Task2, task2

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


def beside_each_other(hemmed: int) -> Task2:
    """Two cubes 17 mm apart: the open jaws do not fit between them, as they must to grip cube `hemmed` only."""
    places = [np.array([0.42, -0.0285, CUBE / 2]), np.array([0.42, 0.0285, CUBE / 2])]
    cubes = [Body(f"cube {i}", Box((CUBE,) * 3), transform(t=t), "cube") for i, t in enumerate(places)]
    targets = [np.array([0.35, -0.3, CUBE / 2 + 1e-3]), np.array([0.35, 0.3, CUBE / 2 + 1e-3])]

    def station(name: str, centre: Array, turns: tuple[int, ...]) -> Station:
        grips = [transform(rot_x(np.pi) @ rot_z(k * np.pi / 2), centre + (0.0, 0.0, 0.012)) for k in turns]
        return Station(name, tuple(frozen(T) for T in grips), frozenset(("table",)))

    transfers = tuple(
        Transfer(
            f"cube {i}",
            station(f"pick {i}", places[i], (0, 2) if i == hemmed else (1, 3)),
            station(f"place {i}", targets[i], (0, 1, 2, 3)),
        )
        for i in range(2)
    )
    scene = Scene(
        load_a465(TOOL_LENGTH, JAW_OPENING),
        load_a465(TOOL_LENGTH, CUBE),
        (TABLE,),
        tuple(cubes),
        frozenset(frozenset((c.name, "table")) for c in cubes),
    )
    return Task2(scene, transfers)
