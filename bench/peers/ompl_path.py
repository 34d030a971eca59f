"""OMPL 2.0: RRT-Connect and all of its simplifier, with any check of configurations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from ompl import base, geometric, util

from arm.controller.unit import Limits
from arm.se3 import Array


def seeded(seed: int) -> None:
    """Seed OMPL's random numbers, and let it print nothing."""
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)


def ompl_path(
    too_near: Callable[[Array], bool],
    limits: Limits,
    ends: tuple[Array, Array],
    fraction: float,
    edge: float,
    plan_s: float,
) -> Array | None:
    """Return way-points (m, n) rad between two configurations (n,) rad, or None.

    Args:
        too_near: whether a configuration is not valid.
        limits: of positions.
        ends: where the path begins and ends.
        fraction: longest part of a motion that is not checked, as a share of the space's extent.
        edge: longest edge of a tree, rad.
        plan_s: wall time at most; iterations cannot be limited through the binding.
    """
    n = len(limits.lower)
    space = base.RealVectorStateSpace(n)
    bounds = base.RealVectorBounds(n)
    for k in range(n):
        bounds.setLow(k, float(limits.lower[k]))
        bounds.setHigh(k, float(limits.upper[k]))
    space.setBounds(bounds)
    space.setLongestValidSegmentFraction(fraction)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: not too_near(np.array([state[k] for k in range(n)])))
    start, goal = space.allocState(), space.allocState()
    for state, q in zip((start, goal), ends, strict=True):
        for k in range(n):
            state[k] = float(q[k])
    information = setup.getSpaceInformation()
    information.setup()
    if information.checkMotion(start, goal):
        return np.stack(ends)
    setup.setStartAndGoalStates(start, goal)
    planner = geometric.RRTConnect(information)
    planner.setRange(edge)
    setup.setPlanner(planner)
    setup.solve(plan_s)
    if not setup.haveExactSolutionPath():
        return None
    setup.simplifySolution()
    path = setup.getSolutionPath()
    states = [path.getState(i) for i in range(path.getStateCount())]
    return np.array([[s[k] for k in range(n)] for s in states])
