"""Directions of a pose that are free within limits: position boxes, a tilt of the tool's axis, a rotation about it.

A rotation from the pose to the tool is split into a swing, which tilts the tool's z axis, and a twist about that axis
(P. Dobrowolski, "Swing-twist decomposition in Clifford algebra", 2015). Coordinates in the pose's own axes are x, y, z
in m, the swing's rotation vector (rx, ry) and the twist rz in rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from arm.numerics.angles import arctan2
from arm.numerics.products import mul, norm
from arm.se3 import Array, frozen, rotation
from plan.kinematics.numeric_ik import FREE

_STRAIGHT = 1e-12  # sine of the tilt below which its direction is undefined


@dataclass(frozen=True)
class Freedom:
    """Limits of a pose's free directions.

    Attributes:
        ranges: lowest and highest value of coordinates, by their names in `plan.kinematics.numeric_ik.FREE`, m or rad.
        tilt: largest angle between the tool's z axis and the pose's, rad.
    """

    ranges: Mapping[str, tuple[float, float]]
    tilt: float = 0.0

    def __bool__(self) -> bool:
        return bool(self.ranges) or self.tilt > 0.0

    def sampled(self, T: Array, count: int, seed: int) -> Array:
        """Return poses (k, 4, 4) within the limits about the pose T: the nearest one, then up to `count` others."""
        names = [name for name in FREE if name in self.ranges]
        low, high = (np.array([self.ranges[name][end] for name in names]) for end in (0, 1))
        dimensions = len(names) + (2 if self.tilt > 0.0 else 0)
        if dimensions == 1:
            unit = np.linspace(0.0, 1.0, count)[:, None]
        else:
            from scipy.stats import qmc  # slow to import

            unit = qmc.Halton(dimensions, seed=seed).random(count)
        coordinates = np.zeros((count + 1, 6))
        columns = [FREE.index(name) for name in names]
        coordinates[0, columns] = np.clip(0.0, low, high)
        coordinates[1:, columns] = low + unit[:, : len(names)] * (high - low)
        if self.tilt > 0.0:  # uniform over the disc
            radius, angle = self.tilt * np.sqrt(unit[:, -2]), 2.0 * np.pi * unit[:, -1]
            coordinates[1:, 3], coordinates[1:, 4] = radius * np.cos(angle), radius * np.sin(angle)
        return frozen(np.stack([_placed(T, row) for row in coordinates]))

    def nearest(self, T: Array, T_now: Array, free: tuple[str, ...]) -> Array:
        """Return the pose within the limits about T that is nearest to T_now; `free` directions keep their values."""
        now = coordinates_of(T, T_now)
        goal = np.zeros(6)
        for k, name in enumerate(FREE):
            if name in free:
                goal[k] = now[k]
            elif name in self.ranges:
                goal[k] = np.clip(now[k], *self.ranges[name])
        if self.tilt > 0.0:
            goal[3:5] = now[3:5] * min(1.0, self.tilt / max(float(norm(now[3:5])), _STRAIGHT))
        return frozen(_placed(T, goal))


def coordinates_of(T: Array, T_now: Array) -> Array:
    """Return the coordinates (6,) of a tool at T_now about the pose T: x, y, z, swing (rx, ry), twist rz."""
    R = T[:3, :3]
    M = mul(R.T, T_now[:3, :3])
    sine = float(norm(M[:2, 2]))
    angle = float(arctan2(sine, M[2, 2]))
    swing = np.zeros(3) if sine < _STRAIGHT else np.array([-M[1, 2], M[0, 2], 0.0]) * (angle / sine)
    N = mul(rotation(swing).T, M)
    twist = float(arctan2(N[1, 0] - N[0, 1], N[0, 0] + N[1, 1]))
    return np.array([*mul(R.T, T_now[:3, 3] - T[:3, 3]), swing[0], swing[1], twist])


def _placed(T: Array, coordinates: Array) -> Array:
    """Invert `coordinates_of`."""
    placed = np.array(T)
    R = T[:3, :3]
    turn = mul(rotation((*coordinates[3:5], 0.0)), rotation((0.0, 0.0, coordinates[5])))
    placed[:3, :3] = mul(R, turn)
    placed[:3, 3] = T[:3, 3] + mul(R, coordinates[:3])
    return placed
