"""Manners are learnt over a bad line too: what it loses once is asked for again."""

from __future__ import annotations

import pytest

from arm.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.mars import Mars
from driver.stepped import SteppedClock


class Drops:
    """A tap that loses the first lines that begin so."""

    def __init__(self, line: bytes, times: int) -> None:
        self.line, self.left = line, times

    def __call__(self, now_s: float, data: bytes) -> bytes:
        if self.left and data.startswith(self.line):
            self.left -= 1
            return b""
        return data


@pytest.mark.parametrize(("line", "times"), [(b"ECHO:0", 2), (b"ECHO:0", 3), (b"ECHO:1", 1), (b"ECHO:1", 2)])
def test_a_unit_that_echoes_is_known_though_what_asks_it_is_lost(
    unit: Unit, clock: SteppedClock, line: bytes, times: int
) -> None:
    drops = Drops(line, times)
    with Emulator(unit, clock) as emulator, Mars(emulator.open_line(0.0, drops), unit, clock) as mars:
        mars.identify()
    assert drops.left == 0
    assert (mars.manners.echoes, mars.manners.adapter) == (True, False)
    assert mars.link.trip_s == mars.link.echo.round_trip_s
    assert "before they are executed" in mars.manners.describe()


@pytest.mark.parametrize("latency_s", [0.0, 0.1])
def test_of_a_unit_that_does_not_echo_the_way_there_and_back_is_measured(
    unit: Unit, clock: SteppedClock, latency_s: float
) -> None:
    with (
        Emulator(unit, clock, options=EmulatorOptions(echo="none")) as emulator,
        Mars(emulator.open_line(latency_s), unit, clock) as mars,
    ):
        mars.identify()
    assert 2 * latency_s <= mars.link.trip_s < 2 * latency_s + 0.05
    assert "NO ECHO (the unit does not)" in mars.manners.describe()
