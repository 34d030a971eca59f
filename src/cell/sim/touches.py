"""What a graded run of a ring along a wire records: how often and how long the tool touches the wire.

Bodies are the true ones: the ring as the world file has it, as a mesh of triangles, where the true arm carries it at
every millisecond of its record; the wire where it truly stands. No certificate has a part in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import coal
import numpy as np
import numpy.typing as npt

from arm.numerics.products import mul
from arm.robot.shapes import Body, Shape, Torus
from arm.robot.tool import FixedTool
from arm.se3 import Array, apply, inverse
from plan.collision.covers import hull
from plan.collision.narrow.coal_shapes import coal_shape

APART_MS = 100  # a touch ends when tool and wire have been apart for so long
_NEAREST = 1e-4  # m, to which the least distance is found
_FACETS = 128  # of a ring: its mesh is off by up to 0.01 mm
_TUBE = 24  # facets of the section of a torus

Times = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class TrueWire:
    """A wire where it truly stands.

    Attributes:
        name: of the wire.
        bodies: of it, with poses in the base frame.
    """

    name: str
    bodies: tuple[Body, ...]


@dataclass(frozen=True)
class Touches:
    """The record of a graded run.

    Attributes:
        wire: its name.
        count: number of touches of the tool and the wire; a touch ends when they have been apart for `APART_MS`.
        seconds: how long they touched in all, s.
        least: least distance of ring and wire, m, to 0.1 mm; 0 if they touched. None if the arm never moved.
    """

    wire: str
    count: int
    seconds: float
    least: float | None

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        least = None if self.least is None else round(1e3 * self.least, 2)
        return {"wire": self.wire, "touches": self.count, "touch_s": self.seconds, "least_mm": least}

    def words(self) -> str:
        """Return it in words."""
        if self.least is None:
            return f"wire {self.wire}: the arm never moved"
        times = "once" if self.count == 1 else f"{self.count} times"
        touched = f"touched {times}, {self.seconds:.2f} s in all" if self.count else "never touched"
        return f"wire {self.wire}: {touched}; the ring came within {1e3 * self.least:.1f} mm of it (ground truth)"


class TouchJudge:
    """Judges the motion of a tool beside a wire.

    Args:
        tool: as it truly is. Its tori are the ring.
        ring: inner and outer diameter and thickness, m, of the true ring, about the tool frame's z axis; None: it is as
            the tool has it.
        wire: as it truly stands.
    """

    def __init__(self, tool: FixedTool, ring: Sequence[float] | None, wire: TrueWire) -> None:
        self._wire = wire
        self._T_tool_flange = inverse(tool.T_flange_tool)
        self._around = [(body.shape, body.T_base_body) for body in tool.bodies]
        parts = [
            (isinstance(body.shape, Torus), body.T_base_body, geometry(body.shape)) for body in tool.bodies
        ]
        if ring is not None:
            parts = [(True, tool.T_flange_tool, washer(ring)), *(part for part in parts if not part[0])]
        self._parts = parts
        self._fixed = [(body.T_base_body, coal_shape(body.shape)) for body in wire.bodies]

    def judged(self, T_base_tool: Array, time_ms: Times) -> Touches:
        """Return the record of a motion.

        Args:
            T_base_tool: (m, 4, 4), the true tool at every ms of motion.
            time_ms: (m,), their times, ascending.
        """
        if len(time_ms) == 0:
            return Touches(self._wire.name, 0, 0.0, None)
        least, touching = self._searched(T_base_tool)
        lasting = np.diff(time_ms, append=time_ms[-1] + 1)
        at = time_ms[touching]
        parted = np.diff(at) - lasting[touching][:-1] >= APART_MS
        count = 0 if len(at) == 0 else 1 + int(parted.sum())
        return Touches(self._wire.name, count, float(lasting[touching].sum()) / 1e3, least)

    def _searched(self, T_base_tool: Array) -> tuple[float, npt.NDArray[np.bool_]]:
        """Return the least distance of ring and wire, and at which poses (m,) the tool touches the wire.

        No point of the tool moves further than the corners of the box around it, so distances between two poses are
        bounded by those at the poses; only where that decides nothing, there is a pose between to look at.
        """
        corners = np.stack([apply(T, self._corners) for T in T_base_tool])
        steps = np.sqrt((np.diff(corners, axis=0) ** 2).sum(axis=2)).max(axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        touching = np.zeros(len(T_base_tool), dtype=bool)
        last = len(T_base_tool) - 1
        found = {i: self.distances(T_base_tool[i]) for i in (0, last)}
        least = min(ring for _, ring in found.values())
        left = [(0, last)]
        while left:
            a, b = left.pop()
            between = (np.array(found[a]) + found[b] - (way[b] - way[a])) / 2.0
            if b - a < 2 or (between[0] > 0.0 and between[1] > max(least - _NEAREST, 0.0)):
                continue
            middle = (a + b) // 2
            found[middle] = self.distances(T_base_tool[middle])
            least = min(least, found[middle][1])
            left += [(a, middle), (middle, b)]
        touching[[i for i, (whole, _) in found.items() if whole <= 0.0]] = True
        return max(least, 0.0), touching

    @cached_property
    def _corners(self) -> Array:
        """Corners (8, 3) of a box around the tool's bodies, in the tool frame."""
        points = []
        for shape, T_flange_body in self._around:
            around, radius = hull(shape)
            at = apply(mul(self._T_tool_flange, T_flange_body), around)
            points += [at - radius, at + radius]
        low, high = np.concatenate(points).min(axis=0), np.concatenate(points).max(axis=0)
        return np.array(
            [(x, y, z) for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
        )

    def distances(self, T_base_tool: Array) -> tuple[float, float]:
        """Return the least distances of tool and wire, and of ring and wire, m; no more than 0 if they touch."""
        T_base_flange = mul(T_base_tool, self._T_tool_flange)
        whole = ring = np.inf
        for is_ring, T_flange_part, part in self._parts:
            T = mul(T_base_flange, T_flange_part)
            nearest = min(_apart(part, T, other, T_other) for T_other, other in self._fixed)
            whole = min(whole, nearest)
            ring = min(ring, nearest) if is_ring else ring
        return whole, ring


def _apart(a: Any, T_a: Array, b: Any, T_b: Array) -> float:
    result = coal.DistanceResult()
    return float(coal.distance(a, _pose(T_a), b, _pose(T_b), coal.DistanceRequest(), result))


def _pose(T: Array) -> Any:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


def geometry(shape: Shape) -> Any:
    """Return a shape as coal has it, a torus as a mesh around it."""
    if isinstance(shape, Torus):
        angle = 2.0 * np.pi * np.arange(_TUBE) / _TUBE
        around = shape.tube / np.cos(np.pi / _TUBE)  # so that the facets touch the tube from outside
        return _revolved(around * np.stack([np.cos(angle), np.sin(angle)], axis=1) + (shape.radius, 0.0))
    return coal_shape(shape)


def washer(ring: Sequence[float]) -> Any:
    """Return a ring of rectangular section as a mesh: inner and outer diameter and thickness, m."""
    inner, outer, half = ring[0] / 2.0, ring[1] / 2.0, ring[2] / 2.0
    return _revolved(np.array([(inner, -half), (outer, -half), (outer, half), (inner, half)]))


def _revolved(section: Array) -> Any:
    """Return the mesh of a closed section (k, 2), radius and height, that is revolved about the z axis."""
    angle = 2.0 * np.pi * np.arange(_FACETS) / _FACETS
    radius, height = section.T
    points = np.stack(
        [np.outer(np.cos(angle), radius), np.outer(np.sin(angle), radius), np.tile(height, (_FACETS, 1))],
        axis=2,
    )
    model = coal.BVHModelOBBRSS()
    faces = np.array(list(_faces(len(section))))
    model.beginModel(len(faces), points.size // 3)
    model.addVertices(points.reshape(-1, 3))
    model.addTriangles(faces)
    model.endModel()
    return model


def _faces(sides: int) -> Iterator[tuple[int, int, int]]:
    for i in range(_FACETS):
        here, there = sides * i, sides * ((i + 1) % _FACETS)
        for k in range(sides):
            after = (k + 1) % sides
            yield here + k, there + k, there + after
            yield here + k, there + after, here + after
