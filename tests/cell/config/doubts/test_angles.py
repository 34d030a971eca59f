"""Joint angles that may be in rad: small, not whole, and a configuration of the arm if they are taken as rad."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from cell.config.doubts.angles import doubt_of_deg, doubt_of_small, doubt_of_turn

UNIT = load_unit("crs93")


@pytest.mark.parametrize("seed", range(5))
def test_a_configuration_in_rad_is_told_with_what_is_meant_in_deg(seed: int) -> None:
    q = np.round(np.random.default_rng(seed).uniform(0.9 * UNIT.lower, 0.9 * UNIT.upper).clip(-3.1, 3.1), 4)
    told = doubt_of_deg(np.radians(q), UNIT)
    assert f"Then it must be [{', '.join(f'{v:.6g}' for v in np.degrees(q))}] in deg" in told
    assert doubt_of_deg(q, UNIT) == ""  # as it is meant


@pytest.mark.parametrize(
    "degrees", [(0, 0, 0, 0, 0, 0), (1, -2, 3, 0, 0, 0), (-60.5, -40, -80, 0, -60, 0), (0.5, 0, 4.0, 0, 0, 0)]
)
def test_whole_degrees_and_large_ones_raise_no_doubt(degrees: tuple[float, ...]) -> None:
    assert doubt_of_deg(np.radians(degrees), UNIT) == ""


@pytest.mark.parametrize(
    ("stated", "meant"),
    [
        (1.57, "89.95"), (-3.14, "-179.9"), (0.52, "29.79"), (0.436, "24.98"), ([0, 0, 1.5708], "[0, 0, 90]"),
        ([-0.26, 0.26], "[-14.9, 14.9]"),
        (0.5, ""), (1.5, ""), (25, ""), (0, ""), (0.61, "34.95"), (0.7, ""), ([0, -10, 0], ""), ([1.57, 40], ""),
        ([0.37, 1.12, -0.64], ""),
    ],
)  # fmt: skip
def test_multiples_of_5_deg_in_rad_are_told(stated: float | list[float], meant: str) -> None:
    found = doubt_of_small(stated)
    assert found == (f"{stated}: is it in rad? Then it must be {meant} in deg" if meant else "")


@pytest.mark.parametrize(
    ("turn", "told"),
    [
        ((0.1745, 0, 0, 0, 0, 0), "is it in rad? Then it must be [9.998, 0, 0, 0, 0, 0] in deg"),
        ((0, 0, -1.571, 0, 0, 0), "is it in rad? Then it must be [0, 0, -90.01, 0, 0, 0] in deg"),
        ((0.05, 0, 0, 0, 0, 0), "the numbers are deg: the joints turn by at most 0.05 deg"),
        ((0.5, 0, 0, 0, 0, 0), ""),
        ((0, 0, 12.345, 0, 0, 0), ""),
        ((0, 0, 0, 0, 0, 0), ""),
    ],
)
def test_a_turn_that_may_be_in_rad_or_is_small_is_told(turn: tuple[float, ...], told: str) -> None:
    found = doubt_of_turn(turn)
    assert told in found
    assert bool(told) == bool(found)
