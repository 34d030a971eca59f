"""Straight lines of the tool as geometry, and the deviation of poses from them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.numerics.angles import arcsin
from arm.numerics.products import mul, norm
from arm.se3 import Array, rotation_vector, skew

AXES = ("x", "y", "z")
TURNS = (None, *AXES, "xy", "xz", "yz", "xyz")
"""What may be free of a tool's rotation on a line: nothing, or turns about one, two or all of its axes."""


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
        """Distance between the ends, m."""
        return float(norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    def reversed(self) -> Line:
        """Return it from its end to its start."""
        return Line(self.T_end, self.T_start)

    @property
    def turn(self) -> Array:
        """Rotation vector (3,) from start to end, rad, in the tool frame at the start."""
        return rotation_vector(mul(self.T_start[:3, :3].T, self.T_end[:3, :3]))

    def poses(self, fraction: Array) -> Array:
        """Return the poses (m, 4, 4) at fractions (m,) of the line."""
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
        """Return the deviation of poses (m, 4, 4) from the line.

        Args:
            T_base_tool: the poses.
            free_axis: one of `TURNS`. None: the angle is that of the whole rotation; one axis: that of its direction;
                two: the part of the rotation vector about the third; three: 0.
            fraction: (m,) places on the line to compare with; default: the nearest ones. A pure rotation needs them.
        """
        along = self.T_end[:3, 3] - self.T_start[:3, 3]
        offset = T_base_tool[:, :3, 3] - self.T_start[:3, 3]
        if fraction is None:
            fraction = np.clip(mul(offset, along) / max(float(mul(along, along)), 1e-18), 0.0, 1.0)
        wanted = self.poses(fraction)
        lateral = np.linalg.norm(T_base_tool[:, :3, 3] - wanted[:, :3, 3], axis=-1)
        apart = T_base_tool[:, :3, :3] - wanted[:, :3, :3]
        # norms of differences keep their digits at small angles, unlike products
        if free_axis is not None and len(free_axis) > 1:
            held = [k for k, name in enumerate(AXES) if name not in free_axis]
            turns = [
                rotation_vector(mul(a.T, b))
                for a, b in zip(wanted[:, :3, :3], T_base_tool[:, :3, :3], strict=True)
            ]
            return LineDeviation(lateral, np.abs(np.array(turns)[:, held]).max(axis=1, initial=0.0))
        if free_axis is not None:
            chord = np.linalg.norm(apart[:, :, AXES.index(free_axis)], axis=-1) / 2.0
        else:
            chord = np.linalg.norm(apart, axis=(-2, -1)) / np.sqrt(8.0)
        return LineDeviation(lateral, 2 * arcsin(chord))


@dataclass(frozen=True)
class LineDeviation:
    """Distances (m,) from a line in m, and angles (m,) from its rotation in rad."""

    distance: Array
    angle: Array
