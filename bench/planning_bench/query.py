"""What is asked of every planner, and what each gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np

from arm.controller.unit import Limits, Unit
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen
from plan.scene import Scene, Transfer

Q_START = frozen(np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0]))
OFFSET = 0.1  # length of the lines at the holes, m
CLEARANCE = 0.005  # asked for in transits and on lines, m


@dataclass(frozen=True)
class Query:
    """Cubes to move from the start back to the start, in the order given.

    Attributes:
        name: of the scene and the query.
        scene: as it stands when the arm sets out.
        transfers: one for a query, four for a whole task.
        q_start: where it begins and ends, (6,) rad, whole counts.
        unit, limits: of the arm at its default registers.
        holes: per transfer, T_base_hole (4, 4) of the pick and of the place.
        seed: for planners that draw.
    """

    name: str
    scene: Scene
    transfers: tuple[Transfer, ...]
    q_start: Array
    unit: Unit
    limits: Limits
    holes: tuple[tuple[Array, Array], ...]
    seed: int


@dataclass(frozen=True)
class Timed:
    """A joint motion from rest to rest by samples, cubic between them.

    Attributes:
        times: (n,) s from 0.
        q, qd: (n, 6) rad and rad/s.
    """

    times: Array
    q: Array
    qd: Array

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    def at(self, times: Array) -> Array:
        """Joint positions (m, 6) rad at times (m,) s, by cubic Hermite interpolation."""
        i = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        h = np.diff(self.times)[i]
        u = np.clip((times - self.times[i]) / h, 0.0, 1.0)[:, None]
        h = h[:, None]
        a, b = self.q[i], self.q[i + 1]
        va, vb = self.qd[i] * h, self.qd[i + 1] * h
        return a + u * (va + u * (3 * (b - a) - 2 * va - vb + u * (2 * (a - b) + va + vb)))


class Sampled(Protocol):
    """A timed motion that can be asked where it is."""

    @property
    def duration(self) -> float: ...

    def at(self, times: Array) -> Array: ...


@dataclass(frozen=True)
class Stretch:
    """All motion between two actions of the gripper, in parts that are made one after another without the gripper."""

    parts: tuple[Sampled, ...]

    @property
    def duration(self) -> float:
        return sum(p.duration for p in self.parts)


@dataclass(frozen=True)
class Answer:
    """What a planner returns.

    Attributes:
        stretches: home to pick, pick to place, and so on to home: 2 * transfers + 1.
        peaks: largest share of the velocity and acceleration limits where the planner's own form of motion lets it
            be computed exactly; else None, and the judge differentiates.
        joins: largest velocity step at joins over what the controller's vertex rule allows, or None.
        certified: proved clearance of transits, m, or None.
        order: per transfer made, indices of the transfers that its cube and its place are of; None as asked.
    """

    stretches: tuple[Stretch, ...]
    peaks: tuple[float, float] | None = None
    joins: float | None = None
    certified: float | None = None
    order: tuple[tuple[int, int], ...] | None = None
    notes: dict[str, Any] = field(default_factory=dict)


class PlannerFailed(Exception):
    """A planner gave no plan; the message says what failed."""


P = TypeVar("P")  # what a planner plans, in its own form


class PlannerUnderTest(Protocol[P]):
    """A planner with everything loaded."""

    def plan(self, query: Query) -> P:
        """Plan; all that this does is counted as planning time.

        Raises:
            PlannerFailed, A465Error: no plan.
        """

    def answer(self, query: Query, planned: P) -> Answer:
        """The plan as the judge takes it; not counted as planning."""


def cube_at(scene: Scene, name: str, T: Array) -> Body:
    """A cube of the scene at another pose."""
    return scene.cube(name).at(T)


def box_size(body: Body) -> tuple[float, float, float]:
    """Edge lengths of a body, m.

    Raises:
        TypeError: it is no box.
    """
    if not isinstance(body.shape, Box):
        raise TypeError(f"{body.name} is a {type(body.shape).__name__}: bodies of these scenes are boxes")
    return body.shape.size


def replaced(cubes: Sequence[Body], cube: Body) -> tuple[Body, ...]:
    """The cubes with one of them moved."""
    return tuple(cube if c.name == cube.name else c for c in cubes)
