"""What a refusal says of places: the nearest misses as the page shows them, with distances that are computed again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from arm.errors import ImpossibleError, InputError
from arm.robot.jaws import after_closing
from arm.robot.model import Robot
from arm.robot.shapes import Body, body_from_json
from arm.se3 import Array, frozen
from cell.preview.overlays import pose_numbers
from plan.collision.world import World, distance_of
from plan.failure import Rejected, failure_in
from plan.kinematics.nearest import asked_pose_from_json, nearest_configuration
from plan.program.setting import Setting, planned_limits

MOST = 12  # misses on a page


@dataclass(frozen=True, eq=False)
class Place:
    """A place that is marked with a circle.

    Attributes:
        name: of it.
        T: 4x4; the circle is about its z axis.
    """

    name: str
    T: Array


@dataclass(frozen=True, eq=False)
class Miss:
    """One way that was rejected, as the page shows it.

    Attributes:
        where: place or step.
        way: yaw and branch there, or "".
        why: in words.
        q: of the arm, rad.
        robot: the arm, with its jaws as they are there.
        cubes: cubes, each with its pose and whether that is in the tool frame.
        pair: the two bodies in red; none if no two bodies are the cause.
        distance: of the two at q, m, as computed for the page.
        points: their nearest points, (2, 3) m.
        required: m, or None if it is not known.
        places: marked with circles; the first one is that to which the tool should come.
        away, turned: by how much the tool misses it, m and rad; None if it does not.
    """

    where: str
    way: str
    why: str
    q: Array
    robot: Robot
    cubes: tuple[tuple[Body, Array, bool], ...]
    pair: tuple[str, ...] = ()
    distance: float | None = None
    points: Array | None = None
    required: float | None = None
    places: tuple[Place, ...] = ()
    away: float | None = None
    turned: float | None = None

    @property
    def name(self) -> str:
        """Where, with yaw and branch."""
        return f"{self.where}, {self.way}" if self.way else self.where

    def to_json(self) -> dict[str, Any]:
        """Return what the page marks, as JSON types; lengths in m, angles in rad."""
        return {
            "where": self.where,
            "way": self.way,
            "why": self.why,
            "pair": list(self.pair),
            "distance": self.distance,
            "points": None if self.points is None else np.round(self.points, 7).tolist(),
            "required": self.required,
            "places": [{"name": place.name, "T": pose_numbers(place.T)} for place in self.places],
            "away": self.away,
            "turned": self.turned,
        }


def misses_of(
    error: ImpossibleError, setting: Setting, q_start: Array, known: Mapping[str, Array]
) -> list[Miss]:
    """Return the misses in a refusal to plan, the nearest first; none if it names neither bodies nor a place.

    Args:
        error: with `plan.failure.Failure`, or with some of its keys itself: ``pair``, ``at``, ``pose``.
        setting: the arm among its bodies, without what the program has moved by then.
        q_start: where the arm is at the start.
        known: places by name, such as holes and boards, which the refusal may name.
    """
    failure = failure_in(error)
    ways = failure.ways if failure is not None else _ways(error)
    shown: dict[str, Miss] = {}
    for way in ways:
        # the configuration nearest to a place that is out of reach belongs to no yaw and no branch
        key = f"{way.where} {way.yaw} {way.branch}" if way.pair else way.where
        if key in shown or len(shown) == MOST:
            continue
        if way.at is not None:
            shown[key] = _of_bodies(way, setting)
        elif way.pose is not None:
            shown[key] = _of_pose(way, setting, q_start, known)
    return list(shown.values()) or _named(error, setting, q_start, known)


def _ways(error: ImpossibleError) -> Iterator[Rejected]:
    """Yield what a refusal without a failure says itself."""
    data = error.data
    if "at" in data and "pair" in data:
        first, second = data["pair"]
        where = str(data.get("step") or data.get("target") or "here")
        required = 1e3 * data["clearance_m"] if "clearance_m" in data else data.get("required_mm")
        yield Rejected(where, str(error), pair=(first, second), required_mm=required, at=data["at"])


def _named(
    error: ImpossibleError, setting: Setting, q_start: Array, known: Mapping[str, Array]
) -> list[Miss]:
    """Return the arm at the start, with the places and bodies that a refusal names; none if it names none."""
    data, names = error.data, list[str]()
    for key in ("hole", "board", "below_mm"):
        some = data.get(key, ())
        names += [some] if isinstance(some, str) else list(some)
    places = tuple(Place(name, known[name]) for name in names if name in known)
    bodies = [body_from_json(body) for body in data.get("bodies", ())]
    pair = tuple(data.get("pair", ()))
    if not places and not pair and not bodies:
        return []
    miss = at_start(str(error), setting, q_start, pair or tuple(body.name for body in bodies), places)
    there = {body.name for body in (*setting.scene.bodies, *setting.scene.cubes)}
    cubes = tuple((body, body.T_base_body, False) for body in bodies if body.name not in there)
    miss = replace(miss, cubes=(*miss.cubes, *cubes), required=data.get("clearance_m"))
    if len(bodies) < 2:
        return [miss]
    first, second = bodies
    near = distance_of(first, second)
    distance = near.value - first.padding - second.padding
    return [replace(miss, where=str(data.get("target", miss.where)), distance=distance, points=near.points)]


def at_start(
    why: str, setting: Setting, q_start: Array, pair: tuple[str, ...] = (), places: tuple[Place, ...] = ()
) -> Miss:
    """Return the arm at the start, with what is marked."""
    robot, cubes = setting.scene.robot_open, _standing(setting)
    return Miss("at q_start", "", why, q_start, robot, cubes, pair, places=places)


def _standing(setting: Setting) -> tuple[tuple[Body, Array, bool], ...]:
    return tuple((cube, cube.T_base_body, False) for cube in setting.scene.cubes)


def _of_bodies(way: Rejected, setting: Setting) -> Miss:
    """Return a miss of two bodies, with their distance computed again."""
    at, pair = way.at or {}, way.pair or ("", "")
    robot, q = _robot(setting, at["robot"]), frozen(np.array(at["q"], dtype=float))
    cubes = _cubes(setting, at, pair)
    held = next(((body, T) for body, T, in_tool in cubes if in_tool), (None, None))
    still = [body.at(T) for body, T, in_tool in cubes if not in_tool]
    world = World(robot, (*setting.scene.bodies, *still), *held)
    required = None if way.required_mm is None else 1e-3 * way.required_mm
    miss = Miss(way.where, _way(way), way.reason, q, robot, cubes, pair, required=required)
    near = next((one for one in world.distances_below(q, np.inf) if set(one.pair) == set(pair)), None)
    if near is None:  # such as the ray that prolongs a wire, which is no body
        return miss
    return replace(miss, pair=near.pair, distance=near.value, points=near.points)


def _robot(setting: Setting, digest: str) -> Robot:
    """Return the arm with the jaws that were checked."""
    opened, holding = setting.scene.robot_open, setting.scene.robot_holding
    found = next(
        (robot for robot in (opened, holding, after_closing(opened)) if robot.digest == digest), None
    )
    if found is None:
        raise InputError("the refusal is of another arm", robot=digest)
    return found


def _cubes(
    setting: Setting, at: Mapping[str, Any], pair: tuple[str, ...]
) -> tuple[tuple[Body, Array, bool], ...]:
    """Return the cubes at their poses then; of copies at places where a cube may be, only one that is in the way."""
    moved, known = at["moved"], {cube.name: cube for cube in setting.scene.cubes}
    found = []
    for cube in setting.scene.cubes:
        if cube.name == at["held"]:
            found.append((cube, frozen(np.array(at["T_tool_held"])), True))
        else:
            found.append((cube, frozen(np.array(moved.get(cube.name, cube.T_base_body))), False))
    for name in pair:
        of = known.get(name.split(" at ")[0])
        if name in moved and name not in known and of is not None:
            copy = Body(name, of.shape, frozen(np.array(moved[name])), of.kind, of.padding)
            found.append((copy, copy.T_base_body, False))
    return tuple(found)


def _of_pose(way: Rejected, setting: Setting, q_start: Array, known: Mapping[str, Array]) -> Miss:
    """Return a miss of a pose that is out of reach, with the arm as near to it as it can be."""
    pose, robot = asked_pose_from_json(way.pose or {}), setting.scene.robot_open
    limits = planned_limits(setting.limits, setting.options, setting.unit)
    nearest = nearest_configuration(robot, pose, limits.lower, limits.upper, [q_start])
    hole = way.where.removeprefix("line at ")
    place = Place(way.where.removeprefix("target "), pose.T_base_tool)
    return Miss(
        way.where,
        _way(way),
        way.reason,
        nearest.q,
        robot,
        _standing(setting),
        places=(place, *(Place(name, T) for name, T in known.items() if name == hole)),
        away=nearest.away,
        turned=nearest.turned,
    )


def _way(way: Rejected) -> str:
    return "" if way.yaw is None else f"yaw {way.yaw}, {way.branch}"
