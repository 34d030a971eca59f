"""The fastest sequence of solutions."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError
from arm.robot.model import Robot
from arm.robot.shapes import Body, Box, Cylinder
from arm.robot.tool import urdf_limits
from arm.se3 import Array, transform
from arms.made_up import SEVEN, arm
from plan.budget import BudgetSpent, Meter, SearchBudget
from plan.collision.bezier import Curve, curve_of_waypoints
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.kinematics.numeric_ik import SearchOptions
from plan.program.goals.line_chains import SequenceStep, TargetReached
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.program.sequence import search as search_module
from plan.program.sequence.layers import lower_bound
from plan.program.sequence.planner import SearchEffort, SequencePlanner
from plan.program.sequence.search import Found, PoseSearch, _Prefix
from plan.program.setting import Setting
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit
from plan.transit.planner import TransitPlanner
from plan.transit.straight import StraightLine
from tasks.pose_lists import FAST, TABLE, down


def test_the_sequence_is_the_best_of_all(robot: Robot, crs97: Unit) -> None:
    """Every sequence of candidates is walked through, with the same costs."""
    bodies = [TABLE, Body("post", Cylinder(0.03, 0.5), transform(t=(0.42, 0.02, 0.2)), "post")]
    targets = [
        Target("a", down(0.45, -0.2, 0.1), free="rz", approach=0.05, retract=0.05),
        Target("b", down(0.45, 0.2, 0.12), free="rz"),
        Target("c", down(0.3, -0.25, 0.2), free="rz", approach=0.04),
    ]
    effort = SearchEffort(candidates=3, detours=99, ik=SearchOptions(samples=8))
    found: list[PoseSearch] = []

    class Spy(SequencePlanner):
        def _written(self, search: PoseSearch, meter: Meter):  # type: ignore[no-untyped-def]
            found.append(search)
            return super()._written(search, meter)

    q = np.radians([-35, -35, -85, 0, -60, 0])
    limits = crs97.limits()
    setting = Setting(Scene(robot, robot, tuple(bodies), ()), virtual_unit(robot, limits), limits, FAST)
    meter = Meter(SearchBudget())
    plan = Spy(setting, targets, setting.at_counts("q_start", q), effort=effort).planned(meter)
    search = found[-1]
    best = search.best(meter)
    times = {}
    for indices in itertools.product(*(range(len(layer.chains)) for layer in search.layers[1:])):
        state: _Prefix | float | None = _Prefix(0, 0, search.worlds.start, 0.0, ())
        for index in indices:
            state = search._taken(state, index, postpone=False) if isinstance(state, _Prefix) else None
        if isinstance(state, _Prefix):
            times[indices] = state.cost
    world = search.worlds.world(search.worlds.start)
    for leg in best.legs:
        assert certify_curve(world, curve_of_waypoints(leg.waypoints), FAST.clearance).proved
    assert len(times) > 8
    assert plan.detours > 0
    assert best.time == pytest.approx(min(times.values()), abs=1e-9)
    assert max(times.values()) > best.time + 0.1
    assert lower_bound(search.layers, search.limits) <= min(times.values())
    assert plan.lower_bound_s <= plan.duration_s < 1.5 * plan.lower_bound_s


def test_few_ways_around_are_made_and_none_better_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A redundant arm has many sequences that are hardly slower than a blocked one."""
    robot = arm(tmp_path, SEVEN, [("l0", "l2"), ("l2", "l4"), ("l4", "l6")])
    bodies = [TABLE, Body("post", Cylinder(0.03, 0.5), transform(t=(0.35, 0.0, 0.25)), "post")]
    targets = [Target("a", down(0.45, -0.3, 0.2)), Target("b", down(0.45, 0.3, 0.2))]
    q = [-0.9, 0.3, 0.0, 1.5, 0.0, 1.2, 0.0]

    def planned() -> Planned:
        return plan_poses(robot, bodies, targets, q, urdf_limits(robot, 4.0), options=FAST)

    late = planned()
    monkeypatch.setattr(PoseSearch, "_detour", lambda self, number: 0.0)
    at_once = planned()
    assert 0 < late.detours < at_once.detours
    assert late.duration_s < 1.02 * at_once.duration_s


def carrying(robot: Robot, unit: Unit, approach: float) -> tuple[PoseSearch, Callable[[], PoseSearch]]:
    """A long box that fits between two plates only if it was gripped along them: a search without detours, and a
    function that returns the same search with nothing known yet.
    """
    box = Body("box", Box((0.12, 0.03, 0.03)), transform(t=(0.4, -0.2, 0.1)), "cube")
    plates = [
        Body(f"plate {side}", Box((0.01, 0.1, 0.1)), transform(t=(0.4 + 0.067 * side, 0.2, 0.055)), "wall")
        for side in (-1, 1)
    ]
    touching = [("box", name) for name in ("finger_l", "finger_r", "palm")]
    pick = Target("pick", down(0.4, -0.2, 0.11), free="rz", approach=0.05, retract=0.05, attach="box",
                  allowed_collisions=touching)  # fmt: skip
    by = Target("by", q=np.radians([0, -35, -85, 0, -60, 0]))
    put = Target("put", down(0.4, 0.2, 0.115), approach=approach)
    scene, found = Scene(robot, robot, (TABLE, *plates), (box,)), list[PoseSearch]()
    setting = Setting(scene, unit, unit.limits(), FAST)

    class Spy(SequencePlanner):
        def _written(self, search: PoseSearch, meter: Meter):  # type: ignore[no-untyped-def]
            found.append(search)
            raise ImpossibleError("seen", detours_spent=True)

    effort = SearchEffort(candidates=6, detours=0, ik=SearchOptions(samples=8))
    q = setting.at_counts("q_start", np.radians([-35, -35, -85, 0, -60, 0]))
    with pytest.raises(ImpossibleError):
        Spy(setting, [pick, by, put], q, effort=effort).planned(Meter(SearchBudget()))
    search = found[0]
    return search, lambda: PoseSearch(setting, search.worlds, search.layers, 0)


def every(search: PoseSearch) -> list[tuple[int, ...]]:
    return list(itertools.product(*(range(len(layer.chains)) for layer in search.layers[1:])))


def walked(search: PoseSearch, indices: tuple[int, ...]) -> tuple[SequenceStep, ...] | None:
    """The steps of one sequence; None if one is refused."""
    state: _Prefix | float | None = _Prefix(0, 0, search.worlds.start, 0.0, ())
    for index in indices:
        state = search._taken(state, index, postpone=False) if isinstance(state, _Prefix) else None
    return state.legs if isinstance(state, _Prefix) else None


@pytest.mark.parametrize("approach", [0.08, 0.0], ids=["line", "transit"])
def test_what_is_clear_is_so_for_what_is_held(robot: Robot, crs97: Unit, approach: float) -> None:
    """No check is of another grasp."""
    search, fresh = carrying(robot, crs97, approach)
    alone = {indices: walked(fresh(), indices) is not None for indices in every(search)}
    outcomes = {last: {alone[i] for i in alone if i[-1] == last} for *_, last in alone}
    assert {True, False} in outcomes.values()  # one solution at the end, blocked or not by what is held
    for order in (every(search), every(search)[::-1]):
        shared = fresh()
        assert {indices: walked(shared, indices) is not None for indices in order} == alone


def test_a_sequence_goes_on_from_every_grasp(robot: Robot, crs97: Unit) -> None:
    """Also from one that comes later to where another, which leads nowhere, was before."""
    search, fresh = carrying(robot, crs97, 0.0)
    alone = {indices: walked(fresh(), indices) is not None for indices in every(search)}
    good = {pick for (pick, *_), clear in alone.items() if clear}
    assert 0 < len(good) < len(search.layers[1].chains)
    for pick in good:
        search.estimates[0][0, pick] += 100.0
    assert search.best(Meter(SearchBudget())).legs[0].index in good


def test_no_sequence_is_that_of_a_clock(robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch) -> None:
    search, tried = carrying(robot, crs97, 0.0)[0], list[bool]()
    for by in ("effort", "clock"):
        tried.clear()

        def spent(deepest: bool, by: str = by) -> Found:
            tried.append(deepest)
            raise BudgetSpent(by, 1.0, 1.0)

        monkeypatch.setattr(search, "_first", spent)
        search.stopped = None
        with pytest.raises(BudgetSpent):
            search.best(Meter(SearchBudget()))
        assert tried == ([False, True] if by == "effort" else [False])


def test_a_near_end_is_left_in_the_world_of_its_time(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the same configuration, with the box in the jaws and without it."""
    search, worlds = carrying(robot, crs97, 0.0)[0], list[World]()
    monkeypatch.setattr(search_module, "leave_near_end", lambda world, *more: worlds.append(world))
    q = search.layers[1].chains[0].q_out
    start, pick = search.worlds.start, search.targets[0]
    held = search.worlds.after(start, pick, robot.T_base_tool(q))
    line = StraightLine(q, q, 0.01, False, 0.0, "from")
    for state in (start, held, start):
        search._left(_Prefix(0, 0, state, 0.0, ()), line)
    assert worlds == [search.worlds.world(state) for state in (start, held)]


def test_a_sequence_is_confirmed_for_what_is_held(
    robot: Robot, crs97: Unit, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples that see nothing take every transit for clear. What cannot be certified is certified the next time."""
    (search, fresh), asked, proofs = carrying(robot, crs97, 0.0), list[float](), list[bool]()
    alone = {indices: walked(fresh(), indices) is not None for indices in every(search)}
    certify, planner = certify_curve, TransitPlanner

    def clear(world: World, a: Array, b: Array, asked: float) -> StraightLine:
        return StraightLine(a, b, asked, True, 0.0)

    def noted(world: World, curve: Curve, clearance: float) -> ClearanceCertificate:
        asked.append(clearance)
        return certify(world, curve, clearance)

    def no_detour(*given: Any, prove: bool) -> TransitPlanner:
        proofs.append(prove)
        found = planner(*given, prove=prove)  # type: ignore[misc]
        monkeypatch.setattr(found, "around", lambda *ends: None)
        return found

    monkeypatch.setattr(search_module, "check_straight", clear)
    monkeypatch.setattr(search_module, "certify_curve", noted)
    monkeypatch.setattr(search_module, "TransitPlanner", no_detour)
    for indices, sound in alone.items():
        one = fresh()
        legs = walked(one, indices)
        assert legs is not None
        asked.clear()
        assert one.confirm(Found(legs, 0.0, 0.0)) == sound == certified(search, legs)
        assert asked == [FAST.clearance] * 3
        assert (walked(one, indices) is not None) == sound
        assert proofs == [] if sound else proofs.pop()
    one, indices = fresh(), next(indices for indices in alone if indices[0] > 0)
    legs = walked(one, indices)
    assert legs is not None
    monkeypatch.setattr(search_module, "certify_curve", lambda *given: OPEN)
    assert not one.confirm(Found(legs, 0.0, 0.0))
    assert one._transits == {}  # all of them are forgotten


OPEN = ClearanceCertificate(0.0, 1.0, ("palm", "wall"), 0.5, False, 1)  # neither proved nor refuted


def certified(search: PoseSearch, legs: Sequence[SequenceStep]) -> bool:
    """Whether all transits of a sequence are certified: to the box, with it to the next goal, and to the plates."""
    worlds, (pick, *_) = search.worlds, search.targets
    held = next(item for item in legs[0].chain.items if isinstance(item, TargetReached))
    states = worlds.start, *[worlds.after(worlds.start, pick, held.T_base_tool)] * 2
    return all(
        certify_curve(worlds.world(state), curve_of_waypoints(leg.waypoints), FAST.clearance).proved
        for state, leg in zip(states, legs, strict=True)
    )
