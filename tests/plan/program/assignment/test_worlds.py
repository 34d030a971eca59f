"""The collision worlds of a task: cubes where they stand, or in the jaws."""

from __future__ import annotations

import numpy as np

from plan.program.assignment.legs import Site
from plan.program.assignment.worlds import TaskWorlds
from tasks.task2 import Q_START, task2


def test_a_placed_cube_stands_in_the_tool_as_it_was_taken() -> None:
    case = task2()
    worlds = TaskWorlds(case.scene, case.transfers, [t.place for t in case.transfers])
    assert worlds.alike
    for number, (transfer, cube) in enumerate(zip(case.transfers, worlds.cubes, strict=True)):
        assert worlds.body(Site(False, number)) is cube
        placed = worlds.body(Site(True, number))
        assert placed.name == f"{cube.name} at {transfer.place.name}"
        held = np.linalg.inv(transfer.place.T_base_tool[0]) @ placed.T_base_body
        assert np.abs(held - worlds.T_tool_held(number)).max() < 1e-12


def test_a_world_is_made_once_and_holds_what_stands_and_what_is_held() -> None:
    case = task2()
    worlds = TaskWorlds(case.scene, case.transfers, [t.place for t in case.transfers])
    all_there = worlds.start
    assert all_there == frozenset(Site(False, i) for i in range(len(case.transfers)))
    assert worlds.empty(all_there) is worlds.empty(all_there)
    assert worlds.empty(all_there) is not worlds.empty(frozenset())
    without = all_there - {Site(False, 0)}
    holding = worlds.holding(0, without)
    assert holding is worlds.holding(0, without)
    assert holding is not worlds.holding(0, without, frozenset({"plate"}))
    assert set(holding.names) == set(worlds.empty(all_there).names)
    assert worlds.cubes[0].name not in worlds.empty(without).names
    assert holding.distance(Q_START).value > 0.0
