"""Joint angles that may be in rad: small, not whole, and a configuration of the arm if they are taken as rad."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import load_unit
from cell.config.doubts.angles import doubt_of_deg

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
