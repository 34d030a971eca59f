"""A straight line of the tool as geometry, and how far a pose is off it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.numerics.angles import arcsin
from arm.numerics.products import mul, norm
from arm.se3 import Array, rotation_vector, skew

AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Line:
    """A straight line of the tool: translation in proportion, rotation at a constant rate about a fixed axis.

    Attributes:
        T_start, T_end: (4, 4) in the base frame.
    """

    T_start: Array
    T_end: Array

    @property
    def length(self) -> float:
        """m."""
        return float(norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) from start to end, rad, in the tool's axes at the start."""
        return rotation_vector(mul(self.T_start[:3, :3].T, self.T_end[:3, :3]))

    def poses(self, fraction: Array) -> Array:
        """Poses (m, 4, 4) at fractions (m,) of the way."""
        turn = self.turn
        angle = float(norm(turn))
        T = np.tile(np.eye(4), (len(fraction), 1, 1))
        T[:, :3, 3] = self.T_start[:3, 3] + fraction[:, None] * (self.T_end[:3, 3] - self.T_start[:3, 3])
        T[:, :3, :3] = self.T_start[:3, :3]
        if angle > 0.0:
            K = mul(self.T_start[:3, :3], skew(turn / angle))
            part = (fraction * angle)[:, None, None]
            T[:, :3, :3] += np.sin(part) * K + 2 * np.sin(part / 2) ** 2 * (mul(K, skew(turn / angle)))
        return T

    def deviation(
        self, T_base_tool: Array, free_axis: str | None = None, fraction: Array | None = None
    ) -> LineDeviation:
        """How far poses (m, 4, 4) are off the line, wherever along it they are.

        Args:
            T_base_tool: the poses.
            free_axis: one of `AXES`: then the angle is that between the tool's axis and the line's.
            fraction: (m,) where along the line they should be, for a turn on the spot.
        """
        along = self.T_end[:3, 3] - self.T_start[:3, 3]
        offset = T_base_tool[:, :3, 3] - self.T_start[:3, 3]
        if fraction is None:
            fraction = np.clip(mul(offset, along) / max(float(mul(along, along)), 1e-18), 0.0, 1.0)
        wanted = self.poses(fraction)
        lateral = np.linalg.norm(T_base_tool[:, :3, 3] - wanted[:, :3, 3], axis=-1)
        apart = T_base_tool[:, :3, :3] - wanted[:, :3, :3]
        # lengths of differences, not products: they keep their digits at small angles
        if free_axis is not None:
            chord = np.linalg.norm(apart[:, :, AXES.index(free_axis)], axis=-1) / 2.0
        else:
            chord = np.linalg.norm(apart, axis=(-2, -1)) / np.sqrt(8.0)
        return LineDeviation(lateral, 2 * arcsin(chord))


@dataclass(frozen=True)
class LineDeviation:
    """Distance from a line (m,) in m, and from its orientation (m,) in rad."""

    distance: Array
    angle: Array
