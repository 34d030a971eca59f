"""Which unit a number outside its range may be in."""

from __future__ import annotations

import numpy as np
import pytest

from arm.numerics.units import unit_meant


@pytest.mark.parametrize(
    ("values", "unit", "low", "high", "asked"),
    [
        (0.06, "mm", 15, 1000, "is it in metres?"),
        (6, "mm", 15, 1000, "is it in cm?"),
        (0.06, "mm/s", 0.1, 2000, "is it in m/s?"),
        (3600, "mm/s", 0.1, 2000, "is it in mm/min?"),
        (500, "s", 0, 60, "is it in ms?"),
        (30, "", 0.01, 1, "is it in percent? 30 % are 0.3"),
        ([0.12, 0.1], "mm", 1, 500, "is it in metres?"),
        ([0.12, 20], "mm", 1, 500, ""),  # one of them is inside
        (0, "mm", 15, 1000, ""),
        (-6, "mm", 15, 1000, ""),
        (2000, "mm", 15, 1000, ""),  # nothing that it is in makes it smaller
        (300, "", 0.01, 1, ""),
        (0.5, "deg", 1, 90, ""),
        (3.1, "deg/s", 100, 1000, "is it in rad/s?"),
        (7500, "V", 0.75, 11.25, "is it in mV?"),
        (40, "kg", 0.005, 2, "is it in g?"),
        (99, "", 0.9, 1.1, "is it in percent? 99 % are 0.99"),
        (50, "", 0.9, 1.1, ""),
    ],
)
def test_the_unit_is_asked_for_in_which_all_are_inside(
    values: object, unit: str, low: float, high: float, asked: str
) -> None:
    assert unit_meant(np.array(values, dtype=float), unit, low, high) == asked
