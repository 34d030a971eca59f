"""Straight out of a place with empty jaws, from rest to rest.

For jaws that closed on nothing: the approach that brought them there was entered at speed, so the way back is timed
anew, and proved like any other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.planfile import Move
from arm.se3 import frozen
from arm.unit import Limits, Unit
from plan.line import Line, LineOptions, follow_line
from plan.motion import Grip, Leg, Mover, Phase
from plan.options import PlanOptions
from plan.scene import Scene
from plan.task import Planner
from plan.world import World

# The approach kept the lines' clearance; this one runs beside it by both lines' tolerances, m.
BESIDE = 5e-4


def plan_back_out(
    scene: Scene, q: npt.ArrayLike, unit: Unit, limits: Limits, options: PlanOptions
) -> tuple[Move, ...]:
    """The way from rest at `q` (6,) rad, `options.offset` back along the tool's axis, with open jaws.

    Args:
        scene: as it stands.
        q: where the jaws are, a whole number of counts.
        unit: whose counts.
        limits: at speed 1.
        options: speed, fractions, offset and clearance of lines.

    Raises:
        ImpossibleError: the arm cannot follow the line, or something is in its way; by how much.
    """
    planner = Planner(scene, np.asarray(q, dtype=float), unit, limits, options)
    robot = scene.robot_open
    T_start = robot.T_base_tool(q)
    T_end = np.array(T_start)
    T_end[:3, 3] -= options.offset * T_start[:3, 2]
    line = Line(frozen(T_start), frozen(T_end))
    followed = follow_line(
        robot, q, line.T_start, line.T_end, planner.planned, LineOptions(slowest=options.slowest)
    )
    world = World(robot, (*scene.bodies, *scene.cubes))
    phase = Phase("back out", "retract", None, world, max(options.line_clearance - BESIDE, 0.0))
    stay = np.stack([followed.q[-1], followed.q[-1]])
    mover = Mover(robot, unit, planner.planned, planner.sent, options)
    return tuple(mover.stopping(Leg((phase, Grip(line, followed)), phase, stay, None)))
