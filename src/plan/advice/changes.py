"""Planning requests and changes of them: move or rotate a body or board, skip a cube, change an option.

A board moves with all that belongs to it (`groups_of`): its plate, its stand, its cubes and its places.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from arm.controller.unit import Limits, Unit
from arm.numerics.products import mul
from arm.plan_file import Plan
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, rotation, transform
from plan.cartesian.reachability import ReachTable, reach_stations
from plan.options import PlanOptions
from plan.program.goals.target import Target
from plan.program.program import Program, plan_program
from plan.program.setting import Setting
from plan.program.tasks import plan_task
from plan.scene import Scene, Station, Transfer

Groups = Mapping[str, frozenset[str]]
_ROUND = transform(np.diag([1.0, -1.0, -1.0]))  # half a turn about x: z points the other way
_LEAST_STAND = 2e-3  # m; a lower stand is removed


@dataclass(frozen=True)
class Request:
    """What is to be planned: transfers, or goals in a given order.

    Attributes:
        scene, transfers, q_start, unit, limits, options, places: arguments of `plan.program.tasks.plan_task`.
        goals: goals in order, instead of transfers.
        required: places that must be in reach too, even if no transfer uses them.
        skip: whether cubes may stay where they are (`plan.program.assignment.planner.Transfers`).
        skipped: what stays for other reasons: ``cube``, ``from`` and ``reason`` of each, for the plan file.
    """

    scene: Scene
    transfers: tuple[Transfer, ...]
    q_start: Array
    unit: Unit
    limits: Limits
    options: PlanOptions = field(default_factory=PlanOptions)
    places: tuple[Station, ...] = ()
    required: tuple[Station, ...] = ()
    skip: bool = False
    skipped: tuple[dict[str, str], ...] = ()
    goals: tuple[Target, ...] = ()

    def plan(
        self, provenance: Mapping[str, Any] | None = None, task: Mapping[str, Any] | None = None
    ) -> Plan | None:
        """Return the plan; None if there is nothing to move.

        Args:
            provenance, task: as `plan.program.tasks.plan_task`.

        Raises:
            ImpossibleError, InputError: as `plan.program.tasks.plan_task`.
        """
        if self.goals:
            given = self.q_start, self.unit, self.limits, self.options
            program = Program(self.scene, self.goals, *given, provenance=provenance or {}, task=task or {})
            return plan_program(program).plan()
        if not self.transfers:
            return None
        given = self.q_start, self.unit, self.limits, self.options
        stated = {**(task or {}), **({"skipped": list(self.skipped)} if self.skipped else {})}
        return plan_task(self.scene, self.transfers, *given, provenance, stated, self.places, skip=self.skip)

    def reach(self, stations: Sequence[Station]) -> ReachTable:
        """Return the reach of places."""
        if not stations:
            return ReachTable(())
        planned = Setting(self.scene, self.unit, self.limits, self.options).planned
        return reach_stations(self.scene.robot_open, planned, stations, self.options)

    def stations(self) -> tuple[Station, ...]:
        """Return all places, each once."""
        every = [s for t in self.transfers for s in (t.pick, t.place)]
        return tuple({s.name: s for s in (*every, *self.places, *self.required)}.values())


def groups_of(scene: Scene, stations: Sequence[Station]) -> dict[str, frozenset[str]]:
    """Group bodies that move together: each ``plate X``, its ``stand X``, its cubes and the places that touch it."""
    known = {b.name for b in scene.bodies}
    plates = sorted(name for name in known if name.startswith("plate "))
    cubes = {c.name for c in scene.cubes}
    groups = {}
    for plate in plates:
        name = plate.removeprefix("plate ")
        inside = {other for pair in scene.allowed if plate in pair for other in pair - {plate}}
        groups[f"board {name}"] = frozenset({plate} | ({f"stand {name}"} & known) | (inside & cubes))
    return groups


@dataclass(frozen=True)
class Change(ABC):
    """One change of a request.

    Attributes:
        text: what the user has to do.
    """

    text: str

    @abstractmethod
    def apply(self, request: Request) -> Request:
        """Return the changed request."""

    @abstractmethod
    def to_json(self) -> dict[str, Any]:
        """Return the change as JSON types; lengths in mm, angles in deg."""


@dataclass(frozen=True)
class MoveBodies(Change):
    """Bodies moved together as one rigid body, with the places on them.

    An upright stand keeps its foot on the table, so raised bodies get a taller one.

    Attributes:
        name: name of the body or board.
        bodies: names of all its bodies.
        by: (3,) translation, m.
        turn: rotation about `axis` (3,) through the point `about` (3,) m, rad.
    """

    name: str
    bodies: frozenset[str]
    by: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: float = 0.0
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    about: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def motion(self) -> Array:
        """Return the displacement, (4, 4) in the base frame."""
        R, centre = rotation(self.turn * np.array(self.axis)), np.array(self.about)
        return transform(R, centre - mul(R, centre) + self.by)

    def apply(self, request: Request) -> Request:
        M, scene = self.motion(), request.scene

        def moved(body: Body) -> Body | None:
            if body.name not in self.bodies:
                return body
            return _adjusted_stand(body, M) if _upright_stand(body) else body.at(mul(M, body.T_base_body))

        def displaced(station: Station) -> Station:
            if not station.touches & self.bodies:
                return station
            return replace(station, T_base_tool=tuple(frozen(mul(M, T)) for T in station.T_base_tool))

        bodies, cubes = (
            tuple(b for b in map(moved, some) if b is not None) for some in (scene.bodies, scene.cubes)
        )
        return replace(
            request,
            scene=replace(scene, bodies=bodies, cubes=cubes),
            transfers=tuple(
                replace(t, pick=displaced(t.pick), place=displaced(t.place)) for t in request.transfers
            ),
            places=tuple(map(displaced, request.places)),
            required=tuple(map(displaced, request.required)),
        )

    def to_json(self) -> dict[str, Any]:
        return {
            "change": "move",
            "what": self.name,
            "bodies": sorted(self.bodies),
            "by_mm": [round(v * 1e3, 3) + 0.0 for v in self.by],
            "turn_deg": round(float(np.degrees(self.turn)), 3),
            "axis": list(self.axis),
            "about_mm": [round(v * 1e3, 3) + 0.0 for v in self.about],
        }


def _upright_stand(body: Body) -> bool:
    return body.kind == "stand" and isinstance(body.shape, Box) and abs(body.T_base_body[2, 2]) > 1.0 - 1e-9


def _adjusted_stand(stand: Body, M: Array) -> Body | None:
    """Return an upright stand moved by M with its foot at the same height; None if it would be too low."""
    size = stand.shape.size if isinstance(stand.shape, Box) else (0.0, 0.0, 0.0)
    T = np.array(mul(M, stand.T_base_body))
    foot = float(stand.T_base_body[2, 3]) - size[2] / 2.0
    top = float(T[2, 3]) + size[2] / 2.0
    if top - foot < _LEAST_STAND:
        return None
    T[2, 3] = (foot + top) / 2.0
    return replace(stand, shape=Box((size[0], size[1], top - foot)), T_base_body=frozen(T))


@dataclass(frozen=True)
class RemoveBodies(Change):
    """Remove a body or cube."""

    name: str

    def apply(self, request: Request) -> Request:
        scene = request.scene
        bodies, cubes = (
            tuple(b for b in some if b.name != self.name) for some in (scene.bodies, scene.cubes)
        )
        allowed = frozenset(pair for pair in scene.allowed if self.name not in pair)
        return replace(request, scene=replace(scene, bodies=bodies, cubes=cubes, allowed=allowed))

    def to_json(self) -> dict[str, Any]:
        return {"change": "take away", "what": self.name}


@dataclass(frozen=True)
class ChangeOptions(Change):
    """Change options."""

    options: tuple[tuple[str, str | float], ...]

    def apply(self, request: Request) -> Request:
        return replace(request, options=replace(request.options, **dict(self.options)))  # type: ignore[arg-type]

    def to_json(self) -> dict[str, Any]:
        return {"change": "options", **dict(self.options)}


@dataclass(frozen=True)
class SkipCubes(Change):
    """Leave cubes where they are."""

    cubes: frozenset[str]

    def apply(self, request: Request) -> Request:
        left = tuple(t for t in request.transfers if t.cube not in self.cubes)
        return replace(request, transfers=left)

    def to_json(self) -> dict[str, Any]:
        return {"change": "skip", "cubes": sorted(self.cubes)}


@dataclass(frozen=True)
class TurnTool(Change):
    """Lead the tool along paths with its z axis in the opposite direction.

    Attributes:
        name: of the step.
        goals: names of its paths.
    """

    name: str
    goals: frozenset[str]

    def apply(self, request: Request) -> Request:
        return replace(request, goals=tuple(self._turned(goal) for goal in request.goals))

    def _turned(self, goal: Target) -> Target:
        if goal.name not in self.goals or goal.T_base_tool is None:
            return goal
        return replace(goal, T_base_tool=frozen(mul(goal.T_base_tool, _ROUND)))

    def to_json(self) -> dict[str, Any]:
        return {"change": "turn tool", "what": self.name, "paths": sorted(self.goals)}
