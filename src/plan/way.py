"""A plan that only goes somewhere: one transit, timed and certified, with empty jaws."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.planfile import Plan
from arm.unit import Limits, Unit
from plan.options import PlanOptions
from plan.scene import Scene
from plan.task import Planner, plan_of
from plan.transfer import MARGIN
from plan.transit import plan_transit
from plan.world import World


def plan_way(
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
        ImpossibleError: there is no clear way; says what is in it and by how much.
    """
    options = options or PlanOptions()
    limits = limits or unit.limits()
    planner = Planner(scene, np.asarray(q_from, dtype=float), unit, limits, options)
    world = World(scene.robot_open, (*scene.bodies, *scene.cubes))
    goal = unit.positions(unit.counts(q_to))
    waypoints = plan_transit(
        world, planner.q, goal, planner.planned, options.clearance + MARGIN, options.seed
    )
    move = planner.way("to the start", world, waypoints)
    if move is None:
        return None
    return plan_of(scene, (move,), unit, limits, options, provenance, {**(task or {}), "cubes": []})
