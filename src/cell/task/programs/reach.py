"""Which stations of a program's paths and poses the arm can reach, and why not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array
from cell.program.planning import T_base_work, program_goals, program_options, program_scene
from cell.program.program_file import ProgramTask
from plan.collision.world import World
from plan.curve.graph import CurveGraph
from plan.program.goals.target import Target
from plan.program.setting import planned_limits
from vision.observation import Observation

_TRIED = 60  # solutions at a station whose distances are computed, until one is clear


@dataclass(frozen=True)
class StationReach:
    """What the arm can do at one station of a path.

    Attributes:
        path: name of the path.
        place: from its start, m.
        position: of the tool, (3,) m.
        solutions: number of solutions within the joint limits, over all samples of the free directions.
        best: largest distance of such a solution less the required clearance, m: the first positive one, or the best of
            those that were tried; None without solutions.
        pair: the bodies that are nearest then.
    """

    path: str
    place: float
    position: tuple[float, float, float]
    solutions: int
    best: float | None
    pair: tuple[str, str]

    @property
    def free(self) -> bool:
        """Whether the arm can be there."""
        return self.best is not None and self.best > 0.0

    def reason(self) -> str:
        """Return what limits it, in words; empty if nothing does."""
        if self.best is None:
            return "out of reach, with all that is free there"
        return "" if self.free else f"{' and '.join(self.pair)} are {-1e3 * self.best:.1f} mm too near"


def path_reach(task: ProgramTask, observation: Observation, speed: float) -> tuple[StationReach, ...]:
    """Return the reach of every station of the program's paths, in order.

    Raises:
        ImpossibleError: the board of the work was not found.
    """
    goals = program_goals(task, T_base_work(task, observation))
    paths = {goal.name: goal for goal in goals if goal.by == "path"}
    return tuple(one for goal in paths.values() for one in _stations(task, observation, speed, goal))


def require_reach(stations: tuple[StationReach, ...]) -> None:
    """Require that the arm can be at every station.

    Raises:
        ImpossibleError: names the first one of each path where it cannot.
    """
    blocked: dict[str, StationReach] = {}
    for station in stations:
        if not station.free:
            blocked.setdefault(station.path, station)
    if blocked:
        shown = "; ".join(f"{s.path!r} at {1e3 * s.place:.0f} mm: {s.reason()}" for s in blocked.values())
        raise ImpossibleError(f"the arm cannot follow {shown}; move the work, or free more directions")


def _stations(
    task: ProgramTask, observation: Observation, speed: float, goal: Target
) -> Iterator[StationReach]:
    scene, options = program_scene(task, observation), program_options(task, speed)
    limits = planned_limits(task.cell.limits, options, task.cell.unit)
    thread = None if goal.threaded is None else scene.thread(goal.threaded)
    names = [body.name for body in scene.robot_open.bodies]
    bodies = scene.bodies if thread is None else (*scene.bodies, thread.ray)
    touching = goal.pairs | (frozenset() if thread is None else thread.exempt(names))
    world = World(scene.robot_open, bodies, allowed=touching)
    graph = CurveGraph(scene.robot_open, goal.curve, world, options.clearance, limits)
    at = goal.curve.poses(graph.places)[:, :3, 3]
    for place, position, reached, q in zip(graph.places, at, graph.reached, graph.q, strict=True):
        best, pair = _best(world, q[reached], options.clearance)
        x, y, z = (float(v) for v in position)
        yield StationReach(goal.name, float(place), (x, y, z), int(reached.sum()), best, pair)


def _best(world: World, q: Array, clearance: float) -> tuple[float | None, tuple[str, str]]:
    """Return the first solution (k, 6) that is clear, or the best of those that were tried."""
    best: float | None = None
    pair = ("", "")
    for one in (
        q[np.unique(np.linspace(0, len(q) - 1, min(len(q), _TRIED)).round().astype(int))] if len(q) else q
    ):
        nearest = world.distance(one)
        if best is None or nearest.value - clearance > best:
            best, pair = nearest.value - clearance, nearest.pair
        if best > 0.0:
            break
    return best, pair
