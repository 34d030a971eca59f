"""The cell as the planner sees it: the arm with open and with closed jaws, bodies, cubes, allowed collisions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from arm.arguments import pairs, rigid, shown
from arm.errors import InputError
from arm.io.storage import sha256
from arm.robot.model import Robot
from arm.robot.shapes import Body, body_from_json, body_to_json
from arm.robot.thread import Thread, thread_from_json
from arm.se3 import Array

Pair = frozenset[str]


@dataclass(frozen=True)
class Scene:
    """A cell at one moment.

    Attributes:
        robot_open: the arm with open jaws.
        robot_holding: the same arm with the jaws at the cube's width.
        bodies: fixed bodies: table, walls, posts, stands, plates.
        cubes: the cubes at their present poses.
        allowed: pairs of names that touch at rest (a cube and the plate with its pocket, a cube and the table).
            Transits still check these pairs; lines to and from a station exempt only `Station.touches`.
        threads: wires on which a ring of the arm may be threaded.
        supplies: names of cubes that come one after the other: the next of a supply is not there before the one in
            front of it has been put down. Each stands at its pose of `cubes` then.
    """

    robot_open: Robot
    robot_holding: Robot
    bodies: tuple[Body, ...]
    cubes: tuple[Body, ...]
    allowed: frozenset[Pair] = field(default_factory=frozenset)
    threads: tuple[Thread, ...] = ()
    supplies: tuple[tuple[str, ...], ...] = ()

    def __post_init__(self) -> None:
        names = [b.name for b in self.robot_open.bodies] + [b.name for b in (*self.bodies, *self.cubes)]
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise InputError(f"scene: two bodies are named {twice[0]!r}; names must differ", names=twice)
        object.__setattr__(self, "allowed", pairs("scene: allowed", self.allowed))
        unknown = sorted(set().union(*self.allowed) - set(names)) if self.allowed else []
        if unknown:
            raise InputError(
                f"scene: allowed contacts name {unknown[0]!r}, which is not a body; "
                f"there are {', '.join(sorted(names))}",
                names=unknown,
            )
        supplied, cubes = [name for supply in self.supplies for name in supply], {c.name for c in self.cubes}
        wrong = sorted({name for name in supplied if name not in cubes or supplied.count(name) > 1})
        if wrong:
            why = f"scene: supplies name {wrong[0]!r}, which must be a cube of the scene, and in one supply once"
            raise InputError(why, names=wrong)

    def absent(self, put_down: Collection[str]) -> frozenset[str]:
        """Return the names of the supplied cubes that are not there yet, if these have been put down."""
        ahead = ([name for name in supply if name not in put_down] for supply in self.supplies)
        return frozenset(name for left in ahead for name in left[1:])

    @property
    def present(self) -> tuple[Body, ...]:
        """Bodies and cubes that are there before anything moves."""
        absent = self.absent(())
        return (*self.bodies, *(cube for cube in self.cubes if cube.name not in absent))

    def allowing(self, allowed: frozenset[Pair]) -> Scene:
        """Return the scene with these allowed contacts."""
        return replace(self, allowed=allowed)

    def with_moved(self, moved: Mapping[str, Array]) -> Scene:
        """Return the scene with bodies and cubes at other poses T_base_body, by name."""
        bodies, cubes = (
            tuple(b.at(moved.get(b.name, b.T_base_body)) for b in some) for some in (self.bodies, self.cubes)
        )
        return replace(self, bodies=bodies, cubes=cubes) if moved else self

    def thread(self, name: str) -> Thread:
        """Return the thread of that name.

        Raises:
            InputError: there is none.
        """
        found = next((thread for thread in self.threads if thread.name == name), None)
        if found is not None:
            return found
        known = ", ".join(thread.name for thread in self.threads) or "none"
        raise InputError(f"threaded = {name!r}: must be a thread of the scene: {known}", name=name)

    def cube(self, name: str) -> Body:
        """Return the cube of that name.

        Raises:
            InputError: there is none.
        """
        found = next((cube for cube in self.cubes if cube.name == name), None)
        if found is not None:
            return found
        known = ", ".join(c.name for c in self.cubes) or "none"
        raise InputError(f"cube = {name!r}: must be a cube of the scene: {known}", name=name)

    def to_json(self) -> dict[str, Any]:
        """Return bodies, cubes, allowed contacts and the arms' digests as JSON types; lengths in m.

        Poses are rounded to 1e-12: the last bit of a matrix product differs between processors and must not change the
        file.
        """
        more: dict[str, Any] = {}
        if self.threads:
            more["threads"] = [thread.to_json() for thread in self.threads]
        if self.supplies:
            more["supplies"] = [list(supply) for supply in self.supplies]
        return {
            "bodies": [_rounded(b) for b in self.bodies],
            "cubes": [_rounded(c) for c in self.cubes],
            "allowed": sorted(sorted(pair) for pair in self.allowed),
            "robot_open": self.robot_open.digest,
            "robot_holding": self.robot_holding.digest,
            **more,
        }

    @cached_property
    def digest(self) -> str:
        """SHA-256 of `to_json`."""
        return sha256(self.to_json())


def _rounded(body: Body) -> dict[str, Any]:
    return body_to_json(body.at(np.round(body.T_base_body, 12) + 0.0))  # + 0.0 makes -0.0 into 0.0


_KEYS = {"bodies", "cubes", "allowed", "robot_open", "robot_holding"}


def scene_from_json(value: dict[str, Any], robot_open: Robot, robot_holding: Robot) -> Scene:
    """Invert `Scene.to_json` for the same arms.

    Raises:
        InputError: the value is malformed, or the arms are not those of the scene.
    """
    if not isinstance(value, dict) or not set(value) >= _KEYS:
        raise InputError("scene: must have bodies, cubes, allowed, robot_open and robot_holding; plan again")
    for key, robot in (("robot_open", robot_open), ("robot_holding", robot_holding)):
        if value[key] != robot.digest:
            why = f"scene: {key} has digest {str(value[key])[:12]}, this arm has {robot.digest[:12]}; plan again"
            raise InputError(why, key=key, scene=value[key], robot=robot.digest)
    bodies, cubes, pairs = value["bodies"], value["cubes"], value["allowed"]
    if not all(isinstance(some, list) for some in (bodies, cubes, pairs)) or not all(map(_pair, pairs)):
        why = "scene: bodies, cubes and allowed must be lists, allowed of pairs of names; plan again"
        raise InputError(why)
    bodies, cubes = (tuple(map(body_from_json, some)) for some in (bodies, cubes))
    threads = value.get("threads", [])
    if not isinstance(threads, list):
        raise InputError("scene: threads must be a list; plan again")
    threads = tuple(map(thread_from_json, threads))
    supplies = value.get("supplies", [])
    if not isinstance(supplies, list) or not all(map(_names, supplies)):
        raise InputError("scene: supplies must be lists of names; plan again")
    allowed = frozenset(map(frozenset, pairs))
    return Scene(
        robot_open, robot_holding, bodies, cubes, allowed, threads, tuple(tuple(names) for names in supplies)
    )


def _names(value: Any) -> bool:
    return isinstance(value, list) and all(isinstance(name, str) for name in value)


def _pair(value: Any) -> bool:
    return _names(value) and len(value) == 2


@dataclass(frozen=True)
class Station:
    """A place where the tool picks or places a cube.

    Attributes:
        name: such as ``01-02/3``.
        T_base_tool: poses of the tool, one per grasp (four yaws of a cube), each (4, 4).
        touches: bodies that the held cube may touch on approach and retract: the plate, or the table.

    Raises:
        InputError: no poses, or one that is not rigid to 1e-6.
    """

    name: str
    T_base_tool: tuple[Array, ...]
    touches: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        name = f"station {self.name!r}"
        if not isinstance(self.T_base_tool, tuple | list) or not self.T_base_tool:
            raise InputError(
                f"{name}: T_base_tool = {shown(self.T_base_tool)}: must be a tuple of 4x4 poses, one per grasp",
                station=self.name,
            )
        poses = tuple(rigid(f"{name}: T_base_tool[{i}]", T) for i, T in enumerate(self.T_base_tool))
        if isinstance(self.touches, str) or not all(isinstance(body, str) for body in self.touches):
            why = f"{name}: touches = {shown(self.touches)}: must be a set of names, such as frozenset(('table',))"
            raise InputError(why, station=self.name)
        object.__setattr__(self, "T_base_tool", poses)
        object.__setattr__(self, "touches", frozenset(self.touches))


@dataclass(frozen=True)
class Transfer:
    """One cube to move.

    Attributes:
        cube: its name.
        pick, place: its present station and its destination.
        look_before: the arm comes to rest this far before its destination, on the approach, for a second look, m; 0 for
            none.
    """

    cube: str
    pick: Station
    place: Station
    look_before: float = 0.0
