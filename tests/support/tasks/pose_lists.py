"""Lists of poses to plan: targets with the tool downwards over a table, and what holds for every plan of one."""

from __future__ import annotations

import itertools

import numpy as np

from arm.controller.unit import Limits
from arm.robot.shapes import Body, Box
from arm.se3 import inverse, rot_x, rotation_vector, transform
from plan.kinematics.numeric_ik import FREE, SearchOptions
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.planned import Planned
from plan.program.sequence.planner import SearchEffort
from plan.trajectory.extremes import segment_extremes

DOWN = rot_x(np.pi)


TABLE = Body("table", Box((1.6, 1.6, 0.04)), transform(t=(0.0, 0.0, -0.06)), "table")


FAST = PlanOptions(speed=1.0)


EFFORT = SearchEffort(candidates=10, ik=SearchOptions(starts=48, samples=16))


def down(x: float, y: float, z: float) -> np.ndarray:
    return transform(DOWN, (x, y, z))


def off(plan: Planned, targets: list[Target]) -> np.ndarray:
    """Largest error on constrained directions per target, m and rad; of two free turns the rotation vector counts."""
    found = []
    for target, reached in zip(targets, plan.reached, strict=True):
        T = inverse(target.poses[0]) @ plan.robot.T_base_tool(reached.q)
        turns = [k for k in range(3) if FREE[3 + k] in target.free]
        turn = rotation_vector(T[:3, :3])
        if len(turns) == 1:  # the free axis itself has to be where it was
            turn = np.cross(T[:3, turns[0]], np.eye(3)[turns[0]])
        held = [k for k in range(6) if FREE[k] not in target.free]
        found.append(np.abs(np.concatenate([T[:3, 3], turn])[held]).max(initial=0.0))
    return np.array(found)


def check_plan(plan: Planned, targets: list[Target], limits: Limits, exact: float = 1e-5) -> None:
    """What holds for every plan."""
    assert off(plan, targets).max() < exact
    times, q = plan.sample(0.005)
    # every target is passed in order, and the plan is without jumps
    first = 0
    for reached, target in zip(plan.reached, targets, strict=True):
        away = np.abs(q - reached.q).max(axis=1)
        if target.blend_radius == 0.0:
            hits = np.flatnonzero(away[first:] < 0.02)
            assert len(hits)
            first += int(hits[0])
    assert np.abs(np.diff(q, axis=0) / np.diff(times)[:, None] / limits.velocity).max() <= 1.0 + 1e-6
    for before, after in itertools.pairwise(plan.moves):
        assert before.path.end == after.path.start
    for move in plan.moves:
        extremes = segment_extremes(move.path, plan.unit)
        assert (extremes.velocity <= limits.velocity * (1 + 1e-9)).all()
        assert (extremes.acceleration <= limits.acceleration * (1 + 1e-9)).all()
        assert (extremes.lower >= limits.lower - 1e-6).all()
        assert (extremes.upper <= limits.upper + 1e-6).all()
        assert move.certified
    assert plan.lower_bound_s <= plan.duration_s
    np.testing.assert_allclose(q[-1], plan.unit.positions(plan.moves[-1].path.end), atol=1e-12)
