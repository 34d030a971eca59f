"""Which stations of a program's paths and poses the arm can reach, and why not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.se3 import Array, transform
from cell.program.planning import (
    T_base_work,
    program_goals,
    program_options,
    program_parts,
    program_scene,
)
from cell.program.program_file import ProgramTask
from plan.collision.world import World
from plan.curve.graph import CurveGraph
from plan.kinematics.numeric_ik import SearchOptions, solve_ik
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.setting import planned_limits
from vision.observation import Observation

_TRIED = 60  # solutions at a station whose distances are computed, until one is clear


@dataclass(frozen=True)
class StationReach:
    """What the arm can do at one station of a path, or at a pose and the ends of its straight lines.

    Attributes:
        step: name of the path or pose.
        place: along the path from its start, with 0.05 m for each rad of turn; or along the tool's z axis from the
            pose (negative before it), m.
        position: of the tool, (3,) m.
        solutions: number of solutions within the joint limits, over all samples of the free directions; collisions
            are not checked.
        best: largest distance of such a solution less the required clearance, m: the first positive one, or the best of
            those that were tried; None without solutions.
        pair: the bodies that are nearest then.
    """

    step: str
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


def program_reach(task: ProgramTask, observation: Observation, speed: float) -> tuple[StationReach, ...]:
    """Return the reach of every station of the program's paths and poses, in order; a path and back counts once.

    What was taken and put down before is where the program has it.

    Raises:
        ImpossibleError: the board of the workpiece was not found, or a part stands nowhere.
    """
    T, parts = T_base_work(task, observation), program_parts(task, observation)
    goals = tuple(program_goals(task, T, parts))
    scene, options = program_scene(task, observation), program_options(task, speed)
    limits = planned_limits(task.cell.limits, options, task.cell.unit)
    worlds, done = AttachmentWorlds(scene, goals), set[str]()
    found = list[StationReach]()
    for number, goal in enumerate(goals):
        if goal.q is not None or goal.name in done:
            continue
        done.add(goal.name)
        if goal.by == "path":
            state = worlds.nominal_state(number)
            world, transit = worlds.on_lines(state, goal), worlds.world(state)
            graph = CurveGraph(worlds.robot, goal.curve, world, options.clearance, limits)
            found += _of_path(world, transit, graph, goal.name, (0,) if goal.back else (0, -1))
        else:
            found += _of_pose(worlds, number, limits, goal.clearance_on_lines(options))
    return tuple(found)


def require_reach(stations: tuple[StationReach, ...]) -> None:
    """Require that the arm can be at every station.

    Raises:
        ImpossibleError: names the first one of each path and pose where it cannot.
    """
    blocked: dict[str, StationReach] = {}
    for station in stations:
        if not station.free:
            blocked.setdefault(station.step, station)
    if blocked:
        shown = "; ".join(f"{s.step!r} at {1e3 * s.place:.0f} mm: {s.reason()}" for s in blocked.values())
        raise ImpossibleError(f"the arm cannot do {shown}; move the workpiece, or free more directions")


def _of_path(
    world: World, transit: World, graph: CurveGraph, name: str, ends: tuple[int, ...]
) -> list[StationReach]:
    """Return the stations of a path; at its `ends` transits begin and end, in which less may touch."""
    at, worlds = graph.curve.poses(graph.places)[:, :3, 3], [world] * len(graph.places)
    for end in ends:
        worlds[end] = transit
    columns = zip(graph.places, at, worlds, graph.reached, graph.q, strict=True)
    return [
        _station(name, float(place), position, of, q[reached], graph.clearance)
        for place, position, of, reached, q in columns
    ]


def _of_pose(
    worlds: AttachmentWorlds, number: int, limits: Limits, clearance: float
) -> Iterator[StationReach]:
    """Yield where the approach begins, the pose, and where the retract ends, as far as there are these lines.

    A retract that ends where the approach began is listed once, with the world in which there is less room.
    """
    goal, options = worlds.targets[number], SearchOptions()
    before, after = (worlds.nominal_state(n) for n in (number, number + 1))
    # transits end where the approach begins, and begin where the retract ends: nothing may touch there
    ends = {-goal.approach: [worlds.world(before)]}
    ends.setdefault(0.0, []).append(worlds.on_lines(before, goal))
    ends.setdefault(-goal.retract, []).append(worlds.world(after))
    poses = goal.poses
    if goal.freedom:
        poses = np.concatenate([goal.freedom.sampled(T, options.poses, options.seed) for T in poses])
    for place, some in ends.items():
        along = transform(t=(0.0, 0.0, place))
        q = solve_ik(worlds.robot, mul(poses, along), limits.lower, limits.upper, goal.free, options).q
        at = mul(goal.poses[0], along)[:3, 3]
        found = [_station(goal.name, place, at, world, q, clearance) for world in some]
        yield min(found, key=lambda one: -np.inf if one.best is None else one.best)


def _station(name: str, place: float, at: Array, world: World, q: Array, clearance: float) -> StationReach:
    """Return the reach of a station with solutions q (k, n)."""
    best, pair = _best(world, q, clearance)
    x, y, z = (float(v) for v in at)
    return StationReach(name, place, (x, y, z), len(q), best, pair)


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
