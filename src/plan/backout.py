"""Straight out of a place with empty jaws, from rest to rest.

For jaws that closed on nothing: the approach that brought them there was entered at speed, so the way back is timed
anew, and proved like any other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError
from arm.planfile import Move
from arm.se3 import frozen
from arm.unit import Limits, Unit
from plan.check import check_move
from plan.line import Line, follow_line
from plan.options import PlanOptions
from plan.scene import Scene
from plan.segments import LineTolerance, to_segments
from plan.timing import time_line
from plan.world import World

# The approach kept the lines' clearance; this one runs beside it by both lines' tolerances, m.
BESIDE = 5e-4


def plan_back_out(
    scene: Scene, q: npt.ArrayLike, unit: Unit, limits: Limits, options: PlanOptions, jaw_opening: float
) -> Move:
    """The way from rest at `q` (6,) rad, `options.offset` back along the tool's axis, with open jaws.

    Args:
        scene: as it stands.
        q: where the jaws are, a whole number of counts.
        unit: whose counts.
        limits: at speed 1.
        options: speed, fractions, offset and clearance of lines.
        jaw_opening: of the open fingers, m.

    Raises:
        ImpossibleError: the arm cannot follow the line, or something is in its way; by how much.
    """
    sent = limits.scaled(options.speed)
    planned = Limits(
        limits.lower,
        limits.upper,
        sent.velocity * options.velocity_fraction,
        sent.acceleration * options.acceleration_fraction,
    )
    robot, start = scene.robot_open, np.asarray(q, dtype=float)
    T_start = robot.T_base_tool(start)
    T_end = np.array(T_start)
    T_end[:3, 3] -= options.offset * T_start[:3, 2]
    line = Line(frozen(T_start), frozen(T_end))
    followed = follow_line(robot, start, line.T_start, line.T_end, planned)
    path = to_segments(
        time_line(followed, planned, options.approach_speed * options.speed),
        unit,
        options.segment_ms,
        limits=sent,
        line=LineTolerance(robot, line),
    )
    least = max(options.line_clearance - BESIDE, 0.0)
    check = check_move(World(robot, (*scene.bodies, *scene.cubes)), path, unit, least)
    if not check.proved:
        raise ImpossibleError(
            f"the jaws cannot back out: {check.pair[0]} comes to {check.seen * 1e3:.2f} mm of {check.pair[1]}, "
            f"{least * 1e3:g} mm are needed; clear the place by hand",
            pair=list(check.pair),
            distance_m=check.seen,
            needed_m=least,
        )
    return Move(
        "back out", "retract", None, path, None, jaw_opening, check.clearance, check.pair, certified=True
    )
