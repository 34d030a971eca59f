"""Manners are learnt over a bad line too: what it loses once is asked for again."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from emulated.near_marks import near_marks


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
    assert "before it is executed" in mars.manners.describe()


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
    assert "NO ECHO (the unit does not echo)" in mars.manners.describe()


@pytest.mark.parametrize("latency_s", [0.0, 0.016, 0.1])
@pytest.mark.parametrize("order", ["before", "mixed"])
@pytest.mark.parametrize("end", ["LF", "CRLF", "CR"])
def test_a_unit_that_echoes_bytes_takes_turns_from_the_beginning(
    unit: Unit, clock: SteppedClock, latency_s: float, order: Any, end: Any
) -> None:
    options = EmulatorOptions(echo="byte", echo_order=order, echo_end=end)
    with (
        Emulator(unit, clock, options=options) as emulator,
        Mars(emulator.open_line(latency_s), unit, clock) as mars,
    ):
        mars.identify()
        assert (mars.manners.echoes, mars.manners.takes_turns) == (True, True)
        assert mars.link.takes_turns


@pytest.mark.parametrize("adapter", [True, False])
def test_turns_are_not_taken_with_a_unit_that_does_not_mix(
    unit: Unit, clock: SteppedClock, adapter: bool
) -> None:
    echo = "none" if adapter else "line"
    options = EmulatorOptions(adapter_echo=adapter, echo=echo, power_up_deg=near_marks(unit))
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise(soft_home=False)
        assert not mars.link.takes_turns


@pytest.mark.parametrize("order", ["before", "mixed"])
def test_a_stop_is_seen_though_turns_were_not_learnt(unit: Unit, clock: SteppedClock, order: Any) -> None:
    """The answer to ST came in the middle of the next question's echo at every look: 'CST=0'."""
    options = EmulatorOptions(echo="byte", echo_order=order, power_up_deg=near_marks(unit))
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise(soft_home=False)
        for _ in range(10):
            mars.link.takes_turns = mars.link.echo.mixed = False
            assert mars.stop().at_rest
            clock.sleep(0.0137)
