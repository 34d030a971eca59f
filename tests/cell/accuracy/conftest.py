"""The calibrated cell of the demonstration, its boards as they truly stand, and a plan: made once for all files."""

from __future__ import annotations

import pytest

from arm.io.storage import data_file
from arm.plan_file import Plan
from cell.config.cell import Cell
from cell.files.task import Task, read_task
from cell.scene.places import reach_of
from cell.task.planning import Rest, plan_rest
from plan.cartesian.reachability import ReachTable
from tasks.true_look import true_look
from vision.observation import Observation


@pytest.fixture(scope="package")
def task() -> Task:
    return read_task(data_file("scenes/realistic/task2.toml"))


@pytest.fixture(scope="package")
def cell(task: Task) -> Cell:
    return task.cell


@pytest.fixture(scope="package")
def seen(task: Task) -> Observation:
    return true_look(task)


@pytest.fixture(scope="package")
def plan(task: Task, seen: Observation) -> Plan:
    made = plan_rest(Rest(task, seen, task.cell.q_start, 0.5))
    assert made is not None
    return made


@pytest.fixture(scope="package")
def table(task: Task, seen: Observation) -> ReachTable:
    return reach_of(task, seen)
