"""One motion from rest to rest with empty jaws, as a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.former import former_names
from arm.plan_file import Plan
from plan.collision.world import World
from plan.failure import nearness
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.program import Program, plan_program
from plan.program.setting import Setting
from plan.scene import Scene


def plan_joint_motion(
    scene: Scene,
    q_from: npt.ArrayLike,
    q_to: npt.ArrayLike,
    unit: Unit,
    limits: Limits | None = None,
    options: PlanOptions | None = None,
    provenance: Mapping[str, Any] | None = None,
    task: Mapping[str, Any] | None = None,
) -> Plan | None:
    """Plan the motion from rest at `q_from` to rest at `q_to` (n,) rad; None if both are the same counts.

    Raises:
        InputError: `q_from` or `q_to` is beyond a limit, or not one finite number per joint.
        ImpossibleError: no collision-free path was found; data: pair, distance_m, clearance_m, and end (``from`` or
            ``to`` if that end is too near to a body, else None).
    """
    options, limits = options or PlanOptions(), limits or unit.limits()
    setting = Setting(scene, unit, limits, options)
    start, goal = setting.at_counts("q_from", q_from), setting.at_counts("q_to", q_to)
    if np.array_equal(start, goal):
        return None
    world = World(scene.robot_open, scene.present)
    for end, q in (("from", start), ("to", goal)):
        closest = world.distance(q)
        if closest.value < (0.0 if options.near_ends else options.clearance):
            raise _refused(closest.pair, closest.value, options.clearance, end)
    goals = (Target("the start", q=goal, role="home", subject="arm"),)
    program = Program(
        scene, goals, start, unit, limits, options, provenance=provenance or {}, task=task or {}
    )
    try:
        return plan_program(program).plan()
    except ImpossibleError as error:
        if "pair" not in error.data:
            raise
        raise _refused(error.data["pair"], error.data["distance_m"], options.clearance, None) from error


def _refused(pair: Sequence[str], distance: float, asked: float, end: str | None) -> ImpossibleError:
    near = nearness(pair, distance, asked)
    if end is None:
        text = f"no path around {pair[1]} was found; on the straight motion {near}; less clearance may help"
    else:
        text = f"the {'start' if end == 'from' else 'end'} of the motion is itself too near: {near}"
    return ImpossibleError(text, pair=list(pair), distance_m=distance, clearance_m=asked, end=end)


former_names(__name__, __name__, plan_way="plan_joint_motion")
