"""Denavit-Hartenberg parameters of serial arms, and those of the A465.

Standard convention (J. Denavit and R. S. Hartenberg, 1955): Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha) per joint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.io.storage import sha256
from arm.se3 import Array, frozen


@dataclass(frozen=True, eq=False)
class DhTable:
    """Denavit-Hartenberg parameters, (joints,) each: d, a in m; alpha, theta_offset in rad."""

    d: Array
    a: Array
    alpha: Array
    theta_offset: Array

    @property
    def digest(self) -> str:
        """SHA-256 of all parameters."""
        return sha256([v.tolist() for v in (self.d, self.a, self.alpha, self.theta_offset)])

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.d)


_QUARTER = np.pi / 2.0

A465 = DhTable(
    d=frozen([0.3052, 0.0, 0.0, 0.3302, 0.0, 0.0762]),
    a=frozen([0.0, 0.3048, 0.0, 0.0, 0.0, 0.0]),
    alpha=frozen([_QUARTER, 0.0, 3.0 * _QUARTER, _QUARTER, 3.0 * _QUARTER, 0.0]),
    theta_offset=frozen([0.0, -3.0 * _QUARTER, -_QUARTER, 0.0, 0.0, 0.0]),
)
"""Source: docs/sources.md, "The arm"; the last frame is the flange of ``urdf/a465/a465.urdf``."""
