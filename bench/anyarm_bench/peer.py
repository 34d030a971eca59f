"""OMPL 2.0: RRT-Connect and all of its simplifier, states checked by the world that our planner uses."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from peers.ompl_path import ompl_path, seeded

from anyarm_bench.problems import Problem
from arm.controller.unit import Limits
from arm.robot.model import Robot
from arm.se3 import Array
from plan.collision.world import World
from plan.kinematics.numeric_ik import solve_ik
from plan.trajectory.time_estimates import straight_time
from plan.trajectory.timing import time_path

PLAN_S = 20.0  # wall time at most of one transit; iterations cannot be limited through the binding
RANGE = 0.5  # rad, longest edge of a tree


@dataclass(frozen=True, eq=False)
class Answer:
    """What a planner returned.

    Attributes:
        ways: way-points (m, n) rad of each transit; empty if one has none.
        cpu_s: of all, and of `search_s` its part from configurations to way-points; s.
        duration_s: of the motion.
    """

    ways: tuple[Array, ...]
    cpu_s: float
    search_s: float
    duration_s: float


class Ompl:
    """The peer.

    Args:
        step: longest part of a motion that is not checked, rad.
    """

    def __init__(self, step: float) -> None:
        self.step = step

    def plan(self, robot: Robot, limits: Limits, problem: Problem, clearance: float) -> Answer:
        """From pose to pose: the solution that is nearest and clear, a path to it, and its time."""
        seeded(problem.seed)
        begin, search = time.process_time(), 0.0
        world = World(robot, problem.bodies)
        at, ways, duration = problem.q_start, list[Array](), 0.0
        for pose in problem.poses:
            solutions = solve_ik(robot, pose, limits.lower, limits.upper).q
            goal = next(
                (q for q in _nearest(solutions, at, limits) if not world.in_collision(q, clearance)), None
            )
            if goal is None:
                return Answer((), time.process_time() - begin, search, 0.0)
            before = time.process_time()
            way = self.transit(world, limits, at, goal, clearance)
            search += time.process_time() - before
            if way is None:
                return Answer((), time.process_time() - begin, search, 0.0)
            duration += time_path(way, limits).duration
            ways.append(way)
            at = goal
        return Answer(tuple(ways), time.process_time() - begin, search, duration)

    def transit(
        self, world: World, limits: Limits, q_from: Array, q_to: Array, clearance: float
    ) -> Array | None:
        """RRT-Connect unless the straight move is free, then all of the simplifier."""
        fraction = self.step / float(np.linalg.norm(limits.upper - limits.lower))
        return ompl_path(world.too_near(clearance), limits, (q_from, q_to), fraction, RANGE, PLAN_S)


def _nearest(solutions: Array, at: Array, limits: Limits) -> list[Array]:
    order = np.argsort(np.round(straight_time(solutions - at, limits), 6), kind="stable")
    return [solutions[i] for i in order]
