"""How often the arm looks."""

from __future__ import annotations

from dataclasses import replace

import pytest

from arm.io.storage import data_file
from arm.plan_file import LookStep
from cell.files.task import Task, read_task
from cell.task.cube_cycles import cube_cycles
from tasks.seen_cells import planned


@pytest.fixture(scope="module")
def task2() -> Task:
    return read_task(data_file("scenes/task2.toml"))


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("look_after", "looks"),
    [("each", [True] * 4), ("never", [False] * 4), (2, [False, True] * 2), (3, [False, False, True, True])],
)
def test_the_arm_looks_as_often_as_the_task_says(
    task2: Task, look_after: str | int, looks: list[bool]
) -> None:
    plan, _ = planned(replace(task2, look_after=look_after))
    assert [v.looks for v in cube_cycles(plan)] == looks


def test_a_second_look_is_on_the_way_to_the_place(task2: Task) -> None:
    cell = replace(task2.cell, second_look="each")
    plan, _ = planned(replace(task2, cell=cell))
    for number, cycle in enumerate(cube_cycles(plan)):
        looks = [step for step in cycle.carry if isinstance(step, LookStep)]
        assert [look.cube for look in looks] == [number]
        assert not any(isinstance(step, LookStep) for step in (*cycle.fetch, *cycle.leave))
        assert cycle.looks
