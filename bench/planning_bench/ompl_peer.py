"""OMPL 2.0: RRT-Connect and its simplifier, states checked by coal's broadphase through Pinocchio.

`fraction` is the longest segment that is not checked, as a share of the space's extent: 1 % is OMPL's own default,
0.2 % the fine row. OMPL knows no lines and no timing: lines are followed in closed form, and TOPP-RA times both
(roboplan's, in C++, so that the two peers differ in search and checking alone).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import roboplan.toppra as toppra
from peers.ompl_path import ompl_path, seeded

from arm.se3 import Array
from plan.collision.world import World
from plan.scene import Station
from planning_bench.grips import GripLine, grip_lines
from planning_bench.judge import OPEN
from planning_bench.query import Answer, Query, Timed
from planning_bench.roboplan_peer import PEAK, arm_scene, every, timed
from planning_bench.sampling import peaks, plan_chain

RANGE = 0.3  # rad
PLAN_S = 2.0  # wall time at most; iterations cannot be limited through the binding
LINE_SAMPLES = 21
LINE_BLEND = 0.0025  # rad


class Ompl:
    """Worlds are built anew whenever a cube changes hands, as its validity checks need."""

    def __init__(self, name: str, fraction: float) -> None:
        self.name, self.fraction = name, fraction
        self._timing: Any = None

    def plan(self, query: Query) -> Answer:
        """All motion of a query."""
        if self._timing is None:
            self._timing = arm_scene(query.limits, OPEN)  # without bodies: it times only
        seeded(query.seed)
        return plan_chain(self, query)

    def answer(self, query: Query, planned: Answer) -> Answer:
        """The plan is the answer."""
        return planned

    def load(self, query: Query) -> None:
        """What stands."""
        self._query = query
        self._cubes = {c.name: c for c in query.scene.cubes}
        self._held: tuple[str, bytes] | None = None
        self._open: World | None = None
        self._grasp: tuple[World, World] | None = None

    def hold(self, cube: str, T_tool_cube: Array, touches: frozenset[str]) -> None:
        """World of transits and world of lines with the cube in the hand."""
        key = (cube, T_tool_cube.tobytes())
        if self._held == key and self._grasp is not None:
            return
        scene = self._query.scene
        still = (*scene.bodies, *(c for n, c in self._cubes.items() if n != cube))
        robot, body = scene.robot_holding, self._cubes[cube]
        may = [frozenset((cube, n)) for n in touches]
        self._grasp = World(robot, still, body, T_tool_cube), World(robot, still, body, T_tool_cube, may)
        self._held = key

    def set_down(self, cube: str, T_base_cube: Array) -> None:
        """The cube stands where it was let go."""
        self._cubes[cube] = self._cubes[cube].at(T_base_cube)
        self._open = None

    def _world(self, holding: bool, line: bool = False) -> World:
        if holding and self._grasp is not None:
            return self._grasp[int(line)]
        if self._open is None:
            scene = self._query.scene
            self._open = World(scene.robot_open, (*scene.bodies, *self._cubes.values()))
        return self._open

    def transit(self, q_from: Array, q_to: Array, holding: bool, seed: int) -> Timed | None:
        """RRT-Connect (a straight way is its first try), then all of the simplifier."""
        world, limits = self._world(holding), self._query.limits
        path = ompl_path(world.in_collision, limits, (q_from, q_to), self.fraction, RANGE, PLAN_S)
        return None if path is None else self._timed(list(path), world)

    def _timed(self, waypoints: list[Array], world: World) -> Timed | None:
        """Blended corners if the timed motion is free at the space's resolution and within limits, else stops."""
        modes = toppra.SplineFittingMode
        if len(waypoints) > 2:
            found = timed(self._timing, waypoints, modes.LinearBlend)
            if (
                found is not None
                and max(peaks(found, self._query.limits)) <= PEAK
                and self._free(world, found)
            ):
                return found
        return timed(self._timing, waypoints, modes.Hermite)

    def _free(self, world: World, found: Timed) -> bool:
        extent = float(np.linalg.norm(self._query.limits.upper - self._query.limits.lower))
        return not any(world.in_collision(found.q[i]) for i in every(found.q, self.fraction * extent))

    def line(self, grip: GripLine, station: Station) -> Timed | None:
        """In closed form every 5 mm, corners blended as roboplan's own Cartesian planner blends them."""
        robot, limits = self._query.scene.robot_open, self._query.limits
        one = Station(station.name, (station.T_base_tool[grip.yaw],))
        fine = grip_lines(robot, one, limits, LINE_SAMPLES)
        if not fine:
            return None
        q = min(fine, key=lambda g: float(np.abs(g.q_offset - grip.q_offset).max())).q[::-1]
        return timed(self._timing, list(q), toppra.SplineFittingMode.LinearBlend, LINE_BLEND)

    def line_free(self, line: Timed, holding: bool) -> bool:
        """Samples no further apart than the space's own resolution."""
        return self._free(self._world(holding, line=True), line)
