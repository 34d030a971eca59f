"""An emulated arm that is switched on close to its marks, so that homing takes next to no time."""

from __future__ import annotations

import numpy as np

from arm.controller.unit import Unit


def near_marks(unit: Unit) -> tuple[float, ...]:
    """Joint positions one count from the marks, deg."""
    return tuple(float(d) for d in np.degrees(unit.positions(np.ones(6))))
