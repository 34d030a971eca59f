"""The collision worlds of a task: cubes where they stand, or in the jaws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.errors import InputError
from arm.robot.shapes import Box
from arm.se3 import transform
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
    assert worlds.everywhere == all_there | {Site(True, j) for j in range(len(case.transfers))}
    assert worlds.empty(all_there) is worlds.empty(all_there)
    assert worlds.empty(all_there) is not worlds.empty(frozenset())
    without = all_there - {Site(False, 0)}
    holding = worlds.holding(0, without)
    assert holding is worlds.holding(0, without)
    assert holding is not worlds.holding(0, without, frozenset({"plate"}))
    assert set(holding.names) == set(worlds.empty(all_there).names)
    assert worlds.cubes[0].name not in worlds.empty(without).names
    assert holding.distance(Q_START).value > 0.0


def test_what_is_held_may_touch_only_what_is_said_and_is_held_by_closed_jaws() -> None:
    case = task2()
    worlds = TaskWorlds(case.scene, case.transfers, [t.place for t in case.transfers])
    cube, plates = (
        worlds.cubes[0].name,
        {name for t in case.transfers for name in t.pick.touches | t.place.touches},
    )
    assert len(plates) == 2
    for touches in (frozenset[str](), case.transfers[0].pick.touches):
        world = worlds.holding(0, frozenset(), touches)
        checked = {frozenset(world.pair_names(i)) for i in range(len(world.pairs))}
        assert {name for name in plates if frozenset((cube, name)) in checked} == plates - touches
        assert frozenset((cube, "camera post")) in checked
        assert world.robot is case.scene.robot_holding
    assert worlds.empty(frozenset()).robot is case.scene.robot_open


def test_cubes_that_stay_are_always_there() -> None:
    case = task2()
    worlds = TaskWorlds(case.scene, case.transfers[1:3], [t.place for t in case.transfers[1:3]])
    for world in (worlds.empty(frozenset()), worlds.holding(0, frozenset())):
        assert {"cube 1", "cube 4"} <= set(world.names)


def test_only_cubes_of_one_shape_and_one_grasp_are_alike() -> None:
    case = task2()
    places = [t.place for t in case.transfers]
    first, *others = case.scene.cubes
    larger = replace(case.scene, cubes=(replace(first, shape=Box((0.042, 0.04, 0.04))), *others))
    assert not TaskWorlds(larger, case.transfers, places).alike
    raised = first.at(first.T_base_body @ transform(t=(0.0, 0.0, 1e-3)))
    assert not TaskWorlds(replace(case.scene, cubes=(raised, *others)), case.transfers, places).alike


@pytest.mark.parametrize("aside", [0.03, 0.08])
def test_a_cube_is_where_it_is_picked(aside: float) -> None:
    case = task2()
    first, *others = case.scene.cubes
    scene = replace(case.scene, cubes=(first.at(first.T_base_body @ transform(t=(aside, 0.0, 0.0))), *others))
    places = [t.place for t in case.transfers]
    if aside < 0.05:
        assert not TaskWorlds(scene, case.transfers, places).alike
        return
    with pytest.raises(InputError, match=r"cube 'cube 1' stands \d+ mm from the tool") as refused:
        TaskWorlds(scene, case.transfers, places)
    assert 0.05 < refused.value.data["distance_m"] < 0.1
