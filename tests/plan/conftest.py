"""What the planner's tests share: the arm, its two units."""

from __future__ import annotations

import pytest

from arm.robot import Robot, load_a465
from arm.unit import UNITS, Unit, load_unit


@pytest.fixture(scope="session")
def robot() -> Robot:
    return load_a465(tool_length=0.134112, jaw_opening=0.06)


@pytest.fixture(scope="session", params=UNITS)
def unit(request: pytest.FixtureRequest) -> Unit:
    return load_unit(request.param)


@pytest.fixture(scope="session")
def crs97() -> Unit:
    return load_unit("crs97")
