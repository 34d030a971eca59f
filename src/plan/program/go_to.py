"""A plan that only goes somewhere: one transit, timed and certified, with empty jaws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.controller.unit import Limits, Unit
from arm.errors import ImpossibleError
from arm.former import former_names
from arm.plan_file import Plan
from plan.collision.search_margin import searched_clearance
from plan.collision.world import World
from plan.failure import nearness
from plan.kinematics.configuration import check_configuration
from plan.motion.builder import MotionBuilder
from plan.motion.phase import MotionPhase
from plan.options import PlanOptions
from plan.program.tasks import ROUNDING, Planner, plan_of
from plan.scene import Scene
from plan.transit.planner import plan_transit


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
    """Plan the way from rest at `q_from` to rest at `q_to` (6,) rad; None if they are the same to the count.

    Raises:
        InputError: `q_from` or `q_to` is beyond a limit, or not six finite numbers.
        ImpossibleError: there is no clear way; says what is in it and by how much; data: pair, distance_m, clearance_m,
            and end (``from``, ``to``, or None where it is on the way).
    """
    options = options or PlanOptions()
    limits = limits or unit.limits()
    planner = Planner(
        scene,
        check_configuration("q_from", q_from, scene.robot_open, limits, ROUNDING),
        unit,
        limits,
        options,
    )
    planner.check_standing("q_from", planner.q_start)
    world = World(scene.robot_open, (*scene.bodies, *scene.cubes))
    goal = planner.check_standing("q_to", q_to)
    if np.array_equal(goal, planner.q_start):
        return None
    asked = options.clearance
    for end, q in (("from", planner.q_start), ("to", goal)):
        closest = world.distance(q)
        if closest.value < asked:
            raise _refused(closest.pair, closest.value, asked, end)
    try:
        waypoints = plan_transit(
            world,
            planner.q_start,
            goal,
            planner.planned,
            searched_clearance(world, (planner.q_start, goal), asked),
            options.seed,
            options.transit,
        )
    except ImpossibleError as error:  # it was asked for more than the caller asked for
        raise _refused(error.data["pair"], error.data["distance_m"], asked, None) from error
    builder = MotionBuilder(scene.robot_open, unit, planner.planned, planner.sent, options)
    moves = builder.run([MotionPhase("arm: to the start", "home", world, options.clearance, waypoints)])
    return plan_of(scene, moves, unit, limits, options, provenance, {**(task or {}), "cubes": []})


def _refused(pair: Sequence[str], distance: float, asked: float, end: str | None) -> ImpossibleError:
    near = nearness(pair, distance, asked)
    if end is None:
        text = f"no path around {pair[1]} was found; on the straight one {near}; less clearance may help"
    else:
        text = f"the {'start' if end == 'from' else 'end'} of the way is itself too near: {near}"
    return ImpossibleError(text, pair=list(pair), distance_m=distance, clearance_m=asked, end=end)


former_names(__name__, __name__, plan_way="plan_joint_motion")
