"""What the planner's tests share: the arm, its two units, Task 2 and what is planned for it."""

from __future__ import annotations

import pytest

from arm.controller.unit import UNITS, Unit, load_unit
from arm.plan_file import Plan
from arm.robot.model import Robot, load_a465
from plan.options import PlanOptions
from plan.program.tasks import plan_task
from tasks.task2 import Q_START, WALL, Task2, task2


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_a465(tool_length=0.134112, jaw_opening=0.06)


@pytest.fixture(scope="session", params=UNITS)
def unit(request: pytest.FixtureRequest) -> Unit:
    return load_unit(request.param)


@pytest.fixture(scope="session")
def crs97() -> Unit:
    return load_unit("crs97")


@pytest.fixture(scope="session")
def case() -> Task2:
    """The default Task 2."""
    return task2()


@pytest.fixture(scope="session")
def plan(case: Task2) -> Plan:
    """Task 2 with a look after each cube, for crs93."""
    return plan_task(case.scene, case.transfers, Q_START, load_unit("crs93"), provenance={"note": "test"})


@pytest.fixture(scope="session")
def direct(case: Task2) -> Plan:
    """The same without looks."""
    return plan_task(
        case.scene, case.transfers, Q_START, load_unit("crs93"), options=PlanOptions(look="never")
    )


@pytest.fixture(scope="session")
def walled() -> Task2:
    """Task 2 with a wall between the boards."""
    return task2(extra=[WALL])


@pytest.fixture(scope="session")
def walled_plan(walled: Task2) -> Plan:
    """Task 2 around the wall, for crs93."""
    return plan_task(walled.scene, walled.transfers, Q_START, load_unit("crs93"))
