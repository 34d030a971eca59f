"""Waiting for the end of a motion: the unit's word, its status, and neither alone."""

from __future__ import annotations

from typing import Any

import pytest

from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.ready import IDLE_POLLS, POLL_S, wait_ready

MOTION_S = 1.6


@pytest.fixture
def says_idle(mars: Mars, fake: Any) -> Any:
    """A motion runs, and the status does not show it."""
    fake.hooks["ST"] = lambda line: ["ST=0"]
    fake.append(MOTION_S, [1000] * 6)
    return fake


def test_an_idle_status_is_no_end_without_the_units_word(
    mars: Mars, says_idle: Any, clock: SteppedClock
) -> None:
    begin = clock.now()
    wait_ready(mars.link, "a motion", 10.0)
    assert MOTION_S - 0.1 <= clock.now() - begin <= MOTION_S + 2 * POLL_S


def test_a_word_that_an_earlier_wait_asked_for_is_not_believed(
    mars: Mars, says_idle: Any, clock: SteppedClock
) -> None:
    """It is still on its way when the new wait begins."""
    says_idle.hooks["STAMP"] = lambda line: says_idle.write(b"R!\r\n")
    begin = clock.now()
    wait_ready(mars.link, "a motion", 10.0)
    assert clock.now() - begin >= MOTION_S - 0.1


@pytest.mark.parametrize(("words", "before"), [((0, 0, 0x10, 0x10), 4), ((0x10,), 1), ((), 0)])
def test_an_idle_unit_that_says_nothing_is_asked_again_after_a_few_looks_in_a_row(
    mars: Mars, fake: Any, words: tuple[int, ...], before: int
) -> None:
    """Those before the unit was busy do not count."""
    status = iter(words)
    fake.hooks["ST"] = lambda line: [f"ST={next(status, 0)}"]
    fake.hooks["R"] = lambda line: [] if fake.lines.count("R:") == 1 else None  # the first is lost
    fake.lines.clear()
    wait_ready(mars.link, "a motion", 10.0)
    first, second = (k for k, line in enumerate(fake.lines) if line == "R:")
    assert fake.lines[first:second].count("ST?") == before + IDLE_POLLS
