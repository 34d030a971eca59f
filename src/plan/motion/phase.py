"""The parts of a motion: phases, each with its own collision world, and how one meets the next."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from arm.se3 import Array, frozen
from plan.cartesian.line import JointPath, Line
from plan.collision.world import World
from plan.curve.tool_curve import ToolCurve


@dataclass(frozen=True, eq=False)
class LinearPath:
    """A straight line or a curve of the tool, and the path of the joints along it.

    Attributes:
        line: where the tool goes.
        path: of the joints.
        speed: cap on the tool's speed, m/s (rad/s for a turn on the spot).
        free_axis: what may turn of the tool; see `plan.cartesian.differential_ik.LineOptions`.
    """

    line: Line | ToolCurve
    path: JointPath
    speed: float
    free_axis: str | None = None

    def reversed(self) -> Self:
        """Return it from its end to its start."""
        path = JointPath(frozen(self.path.q[::-1]), frozen(self.path.s[-1] - self.path.s[::-1]))
        return replace(self, line=self.line.reversed(), path=path)

    def split(self, before_end: float) -> tuple[Self, Self]:
        """Return its two parts; the second one is `before_end` m long."""
        end = float(self.path.s[-1])
        at = end - before_end
        start, middle, goal = self.line.poses(np.array([0.0, at / end, 1.0]))

        def path(first: float, last: float) -> JointPath:
            s = np.linspace(first, last, len(self.path.s))
            return JointPath(frozen(self.path.spline(s)), frozen(s - first))

        return (
            replace(self, line=Line(frozen(start), frozen(middle)), path=path(0.0, at)),
            replace(self, line=Line(frozen(middle), frozen(goal)), path=path(at, end)),
        )


@dataclass(frozen=True, eq=False)
class MotionPhase:
    """A phase of a motion: a line or a transit in one world.

    Attributes:
        name: name of the step.
        role: home, transit, approach, line or retract.
        world: its collision world.
        clearance: required clearance, m.
        path: a line, or the way-points (m, n) rad of a transit.
        cube: index of the cube that it serves, or None.
        held: name of the body that moves with the tool, or None.
        allowed_collisions: names of bodies that the held one may touch.
        allowed_pairs: further pairs of bodies that may touch.
        threaded: name of the thread that a ring of the arm stays on, or None.
    """

    name: str
    role: str
    world: World
    clearance: float
    path: LinearPath | Array
    cube: int | None = None
    held: str | None = None
    allowed_collisions: frozenset[str] = frozenset()
    allowed_pairs: frozenset[frozenset[str]] = frozenset()
    threaded: str | None = None

    @property
    def line(self) -> LinearPath | None:
        """Its line; None for a transit."""
        return self.path if isinstance(self.path, LinearPath) else None

    @property
    def waypoints(self) -> Array | None:
        """The way-points (m, n) rad of a transit; None for a line."""
        return None if isinstance(self.path, LinearPath) else self.path

    def meets(self, path: Array) -> bool:
        """Return whether bodies are nearer than the clearance at one of the configurations (m, n) rad of a path."""
        return any(map(self.world.too_near(self.clearance), path))


@dataclass(frozen=True)
class Join:
    """How a phase meets the one before it.

    Attributes:
        blend_radius: largest distance at which the tool may pass the corner, m; 0 if it must go through it. A line and
            a transit meet at speed in any case, because the blend lies on the transit.
        cut: length that a rounded corner between two lines takes of each, m; 0 if the corner is not rounded.
    """

    blend_radius: float = 0.0
    cut: float = 0.0
