"""Which unit a number outside its range may be in."""

from __future__ import annotations

import numpy as np

from arm.numerics.products import Array

_OTHERS = {  # of numbers in a unit: the units that they may be in, and how many of the unit one of these is
    "mm": (("metres", 1e3), ("cm", 10.0)),
    "mm/s": (("m/s", 1e3), ("mm/min", 1.0 / 60.0)),
    "s": (("ms", 1e-3),),
    "deg/s": (("rad/s", 180.0 / np.pi),),
    "V": (("mV", 1e-3),),
    "kg": (("g", 1e-3),),
}


def unit_meant(values: Array, unit: str, low: float, high: float) -> str:
    """Ask whether numbers outside a range are in another unit, in which they all are inside it; "" if in none.

    Args:
        values: of any shape.
        unit: that they should be in.
        low, high: the range, in that unit.
    """
    found = np.abs(values[np.isfinite(values)])
    if low < 0.0 or len(found) < values.size or not found.all() or (values < 0.0).any():
        return ""
    for other, one in _OTHERS.get(unit, ()):
        beyond = found < low if one > 1.0 else found > high
        outside = beyond.any() if one > 100.0 else beyond.all()  # a small number beside others may be right
        if outside and (found * one >= low).all() and (found * one <= high).all():
            return f"is it in {other}?"
    percent = found * 0.01
    if (
        not unit
        and 1.0 <= high <= 1.5
        and (found >= 2.0).all()
        and (low <= percent).all()
        and (percent <= high).all()
    ):
        return f"is it in percent? {found.ravel()[0]:g} % are {found.ravel()[0] / 100.0:g}"
    return ""
