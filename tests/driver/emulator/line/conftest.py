"""An emulated unit on a pseudo-terminal, in wall time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator
from driver.line.clock import Clock
from emulated.terminal import Terminal


@pytest.fixture
def served(unit: Unit) -> Iterator[Emulator]:
    """Serves ports of the host, twenty times as fast as real."""
    with Emulator(unit, Clock(20.0)) as emulator:
        yield emulator


@pytest.fixture
def terminal(served: Emulator) -> Iterator[Terminal]:
    terminal = Terminal(served.open_pty())
    yield terminal
    terminal.close()
