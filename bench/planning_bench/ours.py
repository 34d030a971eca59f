"""This repository's planner, judged by what would be sent: integer segments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.plan_file import GripperStep, Move, Plan
from arm.se3 import Array
from plan.options import PlanOptions
from plan.program.tasks import plan_task
from plan.trajectory.extremes import segment_extremes
from planning_bench.query import CLEARANCE, Answer, Query, Stretch

VERTEX_S = 5e-3  # a join may step in velocity by what the acceleration limit gives in this time


@dataclass(frozen=True)
class Sent:
    """A motion as the controller makes it."""

    path: CountPath
    unit: Unit

    @property
    def duration(self) -> float:
        return self.path.duration_s

    def at(self, times: Array) -> Array:
        return self.unit.positions(self.path.at(times))


class Ours:
    """`plan.program.tasks.plan_task` at full speed and acceleration, 5 mm of clearance, no looks between cubes."""

    name = "ours"

    def __init__(self) -> None:
        self.options = PlanOptions(
            speed=1.0,
            velocity_fraction=1.0,
            acceleration_fraction=1.0,
            clearance=CLEARANCE,
            approach_speed=2.0,
            look="never",
            certificate="decide",  # what is asked is proved; how much more there is, is not
        )

    def plan(self, query: Query) -> Plan:
        """Planning, with the certificate."""
        return plan_task(query.scene, query.transfers, query.q_start, query.unit, query.limits, self.options)

    def answer(self, query: Query, plan: Plan) -> Answer:
        """What would be sent, for the judge (not counted as planning)."""
        parts: list[list[Sent]] = [[]]
        gripped = False
        for step in plan.steps:
            match step:
                case Move():
                    parts[-1].append(Sent(step.path, query.unit))
                case GripperStep() if (step.action == "close") != gripped:
                    gripped = not gripped
                    parts.append([])
        moves = list(plan.moves)
        # moves between two actions of the gripper are one motion: they may meet at speed
        peaks = [
            _peaks(CountPath(p[0].path.start, tuple(s for m in p for s in m.path.segments)), query)
            for p in parts
        ]
        transits = [m.clearance for m in moves if m.certified and m.role in ("transit", "home")]
        return Answer(
            tuple(Stretch(tuple(p)) for p in parts),
            peaks=(max(p[0] for p in peaks), max(p[1] for p in peaks)),
            joins=max(p[2] for p in peaks),
            certified=min(transits) if transits and all(m.certified for m in moves) else None,
            order=_order(query, plan),
            notes=dict(plan.task.get("bound", {})) if isinstance(plan.task.get("bound"), dict) else {},
        )


def _order(query: Query, plan: Plan) -> tuple[tuple[int, int], ...]:
    """Which cube went where, in the order it was done."""
    cubes = [t.cube for t in query.transfers]
    places = [t.place.name for t in query.transfers]
    return tuple((cubes.index(c["cube"]), places.index(c["to"])) for c in plan.task["cubes"])


def _peaks(path: CountPath, query: Query) -> tuple[float, float, float]:
    extremes = segment_extremes(path, query.unit)
    scale = np.abs(query.unit.counts_per_rad)
    ends = np.stack([path.segments[0].derivative(0.0), path.segments[-1].derivative(1.0)]) / scale
    jumps = np.concatenate([np.abs(ends), extremes.jumps])
    return (
        float((extremes.velocity / query.limits.velocity).max()),
        float((extremes.acceleration / query.limits.acceleration).max()),
        float((jumps / (VERTEX_S * query.limits.acceleration)).max()),
    )
