"""Is a placement of a wire possible at all? A written oracle, apart from the planner.

The wires are the polylines and arcs of the laboratory's drawings. Stations stand every 8 mm along the centre line, from
40 mm outside the free end to 30 mm above the board. At each, the ring's normal is along the wire or tilted by 10, 20 or
30 degrees in six directions, and turned about itself in steps of 20 degrees, on all inverse kinematics branches within
limits. A node counts if the true ring (a washer), the handle and the wrist keep the margin to the bar. The placement is
possible if nodes of all stations are joined by steps of at most 0.5 rad of every joint. Nothing else is looked at: no
table, no board, no forearm, no way to the first station.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from arm.controller.unit import Limits
from arm.robot.model import Robot
from plan.kinematics.ik import inverse_kinematics

Array = npt.NDArray[np.float64]

LINES: dict[str, list[Any]] = {  # mm; an arc is (centre, end), a quarter turn from the point before
    "a": [(0, 0, 0), (0, 0, 200)],
    "b": [(0, 0, 0), (0, 0, 80), (70, 0, 150), (70, 0, 200)],
    "c": [(0, 0, 0), (0, 0, 50), (-50, 0, 100), (-50, -50, 150), (-50, -50, 200)],
    "d": [(0, 0, 0), (0, 0, 30), (-15, 0, 45), (-15, 0, 105), ((35, 0, 105), (35, 0, 155)), (85, 0, 155)],
    "e": [
        (0, 0, 0),
        (0, 0, 30),
        (-17.32, 0, 60),
        (-17.32, -50, 110),
        ((-17.32, 0, 110), (-17.32, 0, 160)),
        (32.68, 50, 160),
        (32.68, 100, 160),
    ],
}
BAR = 0.010  # m, edge of the bar's square section
STEP = 0.008  # m, between stations
OUTSIDE, ABOVE = (
    0.040,
    0.0275,
)  # m, of the first station from the free end, of the last one above the foot plate's top
TILTS_DEG, AZIMUTHS, TURNS = (10.0, 20.0, 30.0), 6, 18
JUMP = 0.5  # rad
RING = (0.030, 0.0348, 0.0033)  # m: inner and outer radius and half thickness
HANDLE = ((0.0348, 0.075, 0.008), (0.075, 0.105, 0.0094), (0.105, 0.155, 0.015))  # m: from, to, width
FLANGE = 0.135  # m, from the ring's centre to the flange's axis along the handle, and
ASIDE = 0.013  # m, from the flange's face to the ring's plane
WRIST = (
    (0.0762 + 0.013, 0.058),
    (0.0381 + 0.013, 0.04),
)  # m: distance of a ball from the ring's plane, and its radius


def centre_line(wire: str) -> Array:
    """Return the centre line of a wire (k, 3) m from its foot to its free end; arcs as chords of 7.5 degrees."""
    points: list[Array] = []
    for one in LINES[wire]:
        if isinstance(one[0], tuple):
            centre, end = (np.array(p, dtype=float) for p in one)
            first, last = points[-1] - centre, end - centre
            angles = np.linspace(0.0, np.pi / 2.0, 13)[1:, None]
            points += list(centre + np.cos(angles) * first + np.sin(angles) * last)
        else:
            points.append(np.array(one, dtype=float))
    return np.array(points) / 1e3


@dataclass(frozen=True)
class _Bar:
    """The straight pieces of a bar: centres (k, 3), axes (k, 3, 3) and half sizes (k, 3), m."""

    centre: Array
    axes: Array
    half: Array

    def distances(self, points: Array) -> Array:
        """Return the distance of points (..., 3) from the bar, m; 0 inside."""
        least = np.full(points.shape[:-1], np.inf)
        for centre, axes, half in zip(self.centre, self.axes, self.half, strict=True):
            beyond = np.maximum(np.abs((points - centre) @ axes) - half, 0.0)
            least = np.minimum(least, np.sqrt((beyond**2).sum(axis=-1)))
        return least


def _bar(line: Array) -> _Bar:
    centres, axes, halves = [], [], []
    for a, b in pairwise(line):
        z = (b - a) / np.linalg.norm(b - a)
        # the bar's sides are parallel to the plane of the bend, or to x and y
        x = np.cross((0.0, 1.0, 0.0), z) if abs(z[1]) < 0.9 else np.array([1.0, 0.0, 0.0]) - z[0] * z
        x = x / np.linalg.norm(x)
        centres.append((a + b) / 2.0)
        axes.append(np.stack([x, np.cross(z, x), z], axis=1))
        halves.append((BAR / 2.0, BAR / 2.0, float(np.linalg.norm(b - a)) / 2.0))
    return _Bar(np.array(centres), np.array(axes), np.array(halves))


def _parts() -> tuple[Array, list[tuple[Array, float]]]:
    """Return points on the ring (k, 3), and points of handle and wrist with their radius, in the ring's frame."""
    angle = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
    inner, outer, half = RING
    ring = np.concatenate(
        [
            np.stack([r * np.cos(angle), r * np.sin(angle), np.full_like(angle, z)], axis=1)
            for r in (inner, outer)
            for z in (-half, 0.0, half)
        ]
    )
    others = []
    for low, high, width in HANDLE:
        x, y, z = np.meshgrid(
            -np.linspace(low, high, 9), np.linspace(-width / 2, width / 2, 3), np.linspace(-half, half, 3)
        )
        others.append((np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1), 0.0))
    others += [(np.array([[-FLANGE, 0.0, away]]), radius) for away, radius in WRIST]
    return ring, others


def stations(wire: str) -> tuple[Array, Array]:
    """Return places (m, 3) along a wire and unit directions (m, 3) there, in its frame, from outside to the foot."""
    line = centre_line(wire)[::-1]
    out = line[0] - line[1]
    line = np.concatenate([[line[0] + OUTSIDE * out / np.linalg.norm(out)], line])
    line[-1, 2] = ABOVE
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    places = np.linspace(0.0, s[-1], int(np.ceil(s[-1] / STEP)) + 1)

    def at(where: Array) -> Array:
        return np.stack([np.interp(where, s, line[:, k]) for k in range(3)], axis=1)

    way = at(np.maximum(places - STEP / 2, 0.0)) - at(np.minimum(places + STEP / 2, s[-1]))
    return at(places), way / np.linalg.norm(way, axis=1)[:, None]


class Oracle:
    """Says whether placements of one wire are possible.

    Args:
        wire: a to e.
        robot: the arm with its tool frame in the ring's centre, z along the ring's normal, the handle along -x.
        limits: of the joints.
    """

    def __init__(self, wire: str, robot: Robot, limits: Limits) -> None:
        self.robot, self.limits = robot, limits
        places, ways = stations(wire)
        bar, (ring, others) = _bar(centre_line(wire)), _parts()
        poses = [
            [self._pose(p, way, *turn) for turn in _turns()] for p, way in zip(places, ways, strict=True)
        ]
        self.T_work_ring = np.array(poses)  # (m, turns, 4, 4)
        T = self.T_work_ring
        self.room = np.empty(T.shape[:2])  # least distance of ring, handle and wrist from the bar, m
        for i, some in enumerate(T):
            placed = [(ring, 0.0), *others]
            found = [
                bar.distances(points @ np.swapaxes(some[:, :3, :3], 1, 2) + some[:, None, :3, 3]).min(axis=1)
                - r
                for points, r in placed
            ]
            self.room[i] = np.min(found, axis=0)

    @staticmethod
    def _pose(place: Array, way: Array, tilt: float, azimuth: float, turn: float) -> Array:
        x = np.cross((0.0, 1.0, 0.0), way) if abs(way[1]) < 0.9 else np.array([1.0, 0.0, 0.0]) - way[0] * way
        x = x / np.linalg.norm(x)
        R = np.stack([x, np.cross(way, x), way], axis=1)
        c, s, a, b = np.cos(tilt), np.sin(tilt), np.cos(azimuth), np.sin(azimuth)
        axis = np.array([[0.0, 0.0, a], [0.0, 0.0, b], [-a, -b, 0.0]])
        tilted = np.eye(3) + s * axis + (1.0 - c) * axis @ axis
        spin = np.array(
            [[np.cos(turn), -np.sin(turn), 0.0], [np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]]
        )
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R @ tilted @ spin, place
        return T

    def possible(self, T_base_work: Array, margin: float) -> bool:
        """Return whether nodes that keep `margin` m join the first station to the last."""
        before: Array | None = None
        for T, room in zip(self.T_work_ring, self.room, strict=True):
            wanted = T_base_work @ T[room >= margin]
            if not len(wanted):
                return False
            q = inverse_kinematics(self.robot, wanted, self.limits.lower, self.limits.upper).q
            if before is not None and len(q):
                near, _ = cKDTree(before).query(q, p=np.inf, distance_upper_bound=JUMP)
                q = q[np.isfinite(near)]
            if not len(q):
                return False
            before = q
        return True


def _turns() -> list[tuple[float, float, float]]:
    """Return tilt, its azimuth, and turn about the normal, rad."""
    tilts = [(0.0, 0.0)] + [
        (np.radians(tilt), azimuth)
        for tilt in TILTS_DEG
        for azimuth in np.arange(AZIMUTHS) * (2.0 * np.pi / AZIMUTHS)
    ]
    turns = np.arange(TURNS) * (2.0 * np.pi / TURNS)
    return [(tilt, azimuth, turn) for tilt, azimuth in tilts for turn in turns]
