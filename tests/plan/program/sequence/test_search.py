"""The fastest sequence of solutions."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.robot.model import Robot
from arm.robot.shapes import Body, Cylinder
from arm.robot.tool import urdf_limits
from arm.se3 import transform
from arms.made_up import SEVEN, arm
from plan.budget import Meter, SearchBudget
from plan.kinematics.numeric_ik import SearchOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.pose_lists import plan_poses
from plan.program.sequence.layers import lower_bound
from plan.program.sequence.planner import SearchEffort, SequencePlanner
from plan.program.sequence.search import PoseSearch
from plan.program.setting import Setting
from plan.scene import Scene
from plan.trajectory.virtual_unit import virtual_unit
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
    from plan.program.sequence.search import _Prefix

    times = {}
    for indices in itertools.product(*(range(len(layer.chains)) for layer in search.layers[1:])):
        state: _Prefix | float | None = _Prefix(0, 0, search.worlds.start, 0.0, ())
        for index in indices:
            state = search._taken(state, index, postpone=False) if isinstance(state, _Prefix) else None
        if isinstance(state, _Prefix):
            times[indices] = state.cost
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
