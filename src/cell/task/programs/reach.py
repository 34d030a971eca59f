"""Which stations of a program's paths and poses the arm can reach, and why not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

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
from plan.collision.world import Distance, World
from plan.curve.graph import CurveGraph
from plan.failure import LINE_BLOCKED, OUT_OF_REACH, Failure, Rejected
from plan.kinematics.nearest import AskedPose
from plan.kinematics.numeric_ik import SearchOptions, solve_ik
from plan.program.goals.attachments import AttachmentWorlds
from plan.program.setting import planned_limits
from vision.observation import Observation

_TOLD = 3  # paths and poses that a refusal names
_TRIED = 60  # solutions at a station whose distances are computed, until one is clear


@dataclass(frozen=True)
class StationReach:
    """What the arm can do at one station of a path, or at a pose and the ends of its straight lines.

    Attributes:
        step: name of the path or pose.
        place: along the path from its start, with 0.05 m for each rad of turn; or along the tool's z axis from the
            pose (negative before it), m.
        pose: what the tool should reach.
        solutions: number of solutions within the joint limits, over all samples of the free directions; collisions
            are not checked.
        required: clearance, m.
        best: largest distance of such a solution less the required clearance, m: the first positive one, or the best of
            those that were tried; None without solutions.
        pair: the bodies that are nearest then.
        at: where they are too near; see `plan.collision.world.World.state`.
    """

    step: str
    place: float
    pose: AskedPose
    solutions: int
    required: float
    best: float | None = None
    pair: tuple[str, str] = ("", "")
    at: Mapping[str, Any] | None = None

    @property
    def position(self) -> tuple[float, float, float]:
        """Of the tool, m."""
        x, y, z = (float(v) for v in self.pose.T_base_tool[:3, 3])
        return x, y, z

    @property
    def free(self) -> bool:
        """Whether the arm can be there."""
        return self.best is not None and self.best > 0.0

    def reason(self) -> str:
        """Return what limits it, in words; empty if nothing does."""
        if self.best is None:
            return "out of reach, with all that is free there"
        return "" if self.free else f"{' and '.join(self.pair)} are {-1e3 * self.best:.1f} mm too near"

    def rejected(self) -> Rejected:
        """Return the station as a rejected way."""
        where = f"{self.step} at {1e3 * self.place:.0f} mm"
        if self.best is None:
            return Rejected(where, self.reason(), pose=self.pose.to_json())
        lengths = 1e3 * (self.best + self.required), 1e3 * self.required
        return Rejected(
            where, self.reason(), pair=self.pair, distance_mm=lengths[0], required_mm=lengths[1], at=self.at
        )


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


def require_reach(stations: tuple[StationReach, ...], note: str = "") -> None:
    """Require that the arm can be at every station; `note` is added to a refusal.

    Raises:
        ImpossibleError: names the first one of each path and pose where it cannot.
    """
    blocked: dict[str, StationReach] = {}
    for station in stations:
        if not station.free:
            blocked.setdefault(station.step, station)
    if blocked:
        some = list(blocked.values())[:_TOLD]
        shown = "; ".join(f"{s.step!r} at {1e3 * s.place:.0f} mm: {s.reason()}" for s in some)
        if len(blocked) > _TOLD:
            shown += f"; and {len(blocked) - _TOLD} more"
        why = f"the arm cannot do {shown}; move the workpiece, or free more directions{note}"
        first, *_ = ways = tuple(station.rejected() for station in blocked.values())
        kind = OUT_OF_REACH if first.pair is None else LINE_BLOCKED
        failure = Failure(kind, first.where, tuple(blocked), why, ways)
        raise ImpossibleError(why, failure=failure.to_json())


def _of_path(
    world: World, transit: World, graph: CurveGraph, name: str, ends: tuple[int, ...]
) -> list[StationReach]:
    """Return the stations of a path; at its `ends` transits begin and end, in which less may touch."""
    curve, worlds = graph.curve, [world] * len(graph.places)
    for end in ends:
        worlds[end] = transit
    columns = zip(graph.places, curve.poses(graph.places), worlds, graph.reached, graph.q, strict=True)
    return [
        _station(name, float(place), AskedPose(T, curve.freedom, curve.free), of, q[reached], graph.clearance)
        for place, T, of, reached, q in columns
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
        pose = AskedPose(mul(goal.poses[0], along), goal.freedom, tuple(goal.free))
        found = [_station(goal.name, place, pose, world, q, clearance) for world in some]
        yield min(found, key=lambda one: -np.inf if one.best is None else one.best)


def _station(
    name: str, place: float, pose: AskedPose, world: World, q: Array, clearance: float
) -> StationReach:
    """Return the reach of a station with solutions q (k, n): the first one that is clear, or the best of some."""
    some = np.linspace(0, max(len(q) - 1, 0), min(len(q), _TRIED)).round().astype(int)
    best: tuple[Distance, Array] | None = None
    for one in q[np.unique(some)]:
        nearest = world.distance(one)
        if best is None or nearest.value > best[0].value:
            best = nearest, one
        if nearest.value > clearance:
            break
    if best is None:
        return StationReach(name, place, pose, len(q), clearance)
    nearest, at = best
    there = None if nearest.value > clearance else world.state(at)["at"]
    return StationReach(name, place, pose, len(q), clearance, nearest.value - clearance, nearest.pair, there)
