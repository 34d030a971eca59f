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
from arm.se3 import Array, frozen, rotations
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
        return frozen(placed(T, coordinates))

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
        return frozen(placed(T, goal))

    def excess(self, T: Array, T_now: Array, free: tuple[str, ...] = ()) -> tuple[Array, Array]:
        """Return how far tools at T_now (..., 4, 4) are beyond the limits about poses T: (...) m and (...) rad.

        Directions in `free` have no limits.
        """
        now = coordinates_of(T, T_now)
        low, high = self.box(free)
        beyond = np.maximum(np.maximum(low - now, now - high), 0.0)
        # a twist near half a revolution may be met from the other side
        twist = now[..., 5:] + 2.0 * np.pi * np.arange(-1.0, 2.0)
        beyond[..., 5] = np.maximum(np.maximum(low[5] - twist, twist - high[5]), 0.0).min(axis=-1)
        if self.tilt > 0.0:
            beyond[..., 3] = np.maximum(np.sqrt((now[..., 3:5] ** 2).sum(axis=-1)) - self.tilt, 0.0)
            beyond[..., 4] = 0.0
        square = beyond**2
        return np.sqrt(square[..., :3].sum(axis=-1)), np.sqrt(square[..., 3:].sum(axis=-1))

    def box(self, free: tuple[str, ...] = ()) -> tuple[Array, Array]:
        """Return the lowest and highest value of each coordinate, (6,) each; a tilt has the square around its disc."""
        low, high = np.zeros(6), np.zeros(6)
        for k, name in enumerate(FREE):
            if name in free:
                low[k], high[k] = -np.inf, np.inf
            elif name in self.ranges:
                low[k], high[k] = self.ranges[name]
        if self.tilt > 0.0:
            low[3:5], high[3:5] = -self.tilt, self.tilt
        return low, high


def coordinates_of(T: Array, T_now: Array) -> Array:
    """Return the coordinates (..., 6) of tools at T_now (..., 4, 4) about poses T: x, y, z, swing (rx, ry), twist rz.

    Positions in m, angles in rad.
    """
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    M = mul(R, T_now[..., :3, :3])
    x, y = -M[..., 1, 2], M[..., 0, 2]
    sine = np.sqrt(x * x + y * y)
    angle = arctan2(sine, M[..., 2, 2])
    size = np.where(sine < _STRAIGHT, 0.0, angle / np.maximum(sine, _STRAIGHT))
    x, y = x * size, y * size
    N = mul(np.swapaxes(_swing(x, y), -1, -2), M)
    twist = arctan2(N[..., 1, 0] - N[..., 0, 1], N[..., 0, 0] + N[..., 1, 1])
    shift = mul(R, (T_now[..., :3, 3] - T[..., :3, 3])[..., None])[..., 0]
    return np.concatenate([shift, np.stack([x, y, twist], axis=-1)], axis=-1)


def placed(T: Array, coordinates: Array) -> Array:
    """Return the poses (..., 4, 4) of tools with coordinates (..., 6) about poses T (..., 4, 4), broadcast."""
    T, c = np.asarray(T), np.asarray(coordinates)
    shape = np.broadcast_shapes(T.shape[:-2], c.shape[:-1])
    swing, twist = _swing(c[..., 3], c[..., 4]), c[..., 5]
    spin = np.zeros_like(swing)
    spin[..., 0, 0] = spin[..., 1, 1] = np.cos(twist)
    spin[..., 1, 0] = np.sin(twist)
    spin[..., 0, 1] = -spin[..., 1, 0]
    spin[..., 2, 2] = 1.0
    found = np.zeros((*shape, 4, 4))
    R = T[..., :3, :3]
    found[..., :3, :3] = mul(R, mul(swing, spin))
    found[..., :3, 3] = T[..., :3, 3] + mul(R, c[..., :3, None])[..., 0]
    found[..., 3, 3] = 1.0
    return found


def _swing(x: Array, y: Array) -> Array:
    """Return the rotations (..., 3, 3) by rotation vectors (x, y, 0)."""
    return rotations(np.stack([x, y, np.zeros_like(x)], axis=-1))
