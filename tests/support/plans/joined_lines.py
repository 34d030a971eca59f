"""A line, a transit and a line as one path."""

from __future__ import annotations

import numpy.typing as npt

from arm.controller.unit import Limits
from plan.cartesian.line import JointPath
from plan.trajectory.joint_path import Chained, Stretch, chained


def joined(
    before: JointPath | None,
    waypoints: npt.ArrayLike,
    after: JointPath | None,
    limits: Limits,
    tool_speed: float | None = None,
    blend: float = 1.0,
) -> Chained:
    """Chain two lines, or one or none (None), and the transit between them; `tool_speed` caps both lines."""
    ends = [[Stretch(line, tool_speed)] if line is not None else [] for line in (before, after)]
    return chained([*ends[0], waypoints, *ends[1]], limits, blend)
