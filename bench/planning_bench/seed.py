"""The course report's method: inverse kinematics nearest to where the arm is, straight joint moves.

See docs/sources.md, "The course report", section 2.4.

Grips are aligned with the hole (one yaw), and the arm goes through its start between pick and place. After letting go
the report goes straight home; `retract` first goes back to the offset point, as the report does after gripping.
"""

from __future__ import annotations

import itertools

import numpy as np

from arm.se3 import Array
from plan.kinematics.ik import inverse_kinematics
from planning_bench.query import Answer, PlannerFailed, Query, Stretch
from planning_bench.scenes import offset_pose
from planning_bench.straight import straight


class Seed:
    """The report's method, with or without the retract."""

    def __init__(self, retract: bool) -> None:
        self.retract = retract
        self.name = "seed+retract" if retract else "seed"

    def plan(self, query: Query) -> Answer:
        """Every transfer from home to home."""
        home = query.q_start
        parts: list[list[Array]] = [[home]]
        for transfer in query.transfers:
            above = _nearest(query, offset_pose(transfer.pick.T_base_tool[0]), home)
            at = _nearest(query, transfer.pick.T_base_tool[0], above)
            parts[-1] += [above, at]
            above_place = _nearest(query, offset_pose(transfer.place.T_base_tool[0]), home)
            at_place = _nearest(query, transfer.place.T_base_tool[0], above_place)
            parts.append([at, above, home, above_place, at_place])
            parts.append([at_place, *([above_place] if self.retract else []), home])
        return Answer(
            tuple(
                Stretch(tuple(straight(a, b, query.limits) for a, b in itertools.pairwise(p))) for p in parts
            )
        )

    def answer(self, query: Query, planned: Answer) -> Answer:
        """The plan is the answer."""
        return planned


def _nearest(query: Query, T_base_tool: Array, q: Array) -> Array:
    found = inverse_kinematics(query.scene.robot_open, T_base_tool, query.limits.lower, query.limits.upper)
    if not len(found):
        raise PlannerFailed("no inverse kinematics within limits")
    return np.asarray(found.q[int(np.argmin(np.linalg.norm(found.q - q, axis=1)))])
