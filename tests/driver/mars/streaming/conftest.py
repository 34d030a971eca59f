"""A scripted unit that is at its soft home when a test of streaming begins."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit
from driver.line.clock import Clock
from wire.controlled_stream import opened


@pytest.fixture
def mars(fake: Any, unit: Unit, clock: Clock) -> Any:
    yield from opened(fake, unit, clock)
