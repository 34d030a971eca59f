"""A unit whose clock does not go on was switched off and on; one damaged sample is not that."""

from __future__ import annotations

import random

import pytest

from driver.line.protocol import CLOCK_RANGE_MS
from driver.line.unit_time import SLACK_S, UnitTime


def told(now_s: float, off_ms: int = 0) -> int:
    return (round(now_s * 1e3) + off_ms) % CLOCK_RANGE_MS


def test_a_clock_that_goes_on_never_jumps_across_its_wrap_and_with_answers_that_come_late() -> None:
    rng, unit_time, now_s = random.Random(1), UnitTime(), 0.0
    for _ in range(3000):
        now_s += rng.uniform(0.05, 9.0)
        late_s = rng.uniform(0.0, 0.9 * SLACK_S)
        assert not unit_time.jumped(now_s, now_s, told(now_s - late_s))
    assert now_s * 1e3 > 100 * CLOCK_RANGE_MS


@pytest.mark.parametrize("off_ms", [4000, 30_000, -4000, CLOCK_RANGE_MS // 2])
def test_one_sample_with_a_digit_changed_is_no_restart_and_two_that_agree_are(off_ms: int) -> None:
    unit_time = UnitTime()
    assert not unit_time.jumped(9.6, 9.6, told(9.6, off_ms))  # the first of all is the damaged one
    assert not unit_time.jumped(9.8, 9.8, told(9.8))
    assert not unit_time.jumped(10.0, 10.0, told(10.0))
    assert not unit_time.jumped(10.2, 10.2, told(10.2, off_ms))
    assert not unit_time.jumped(10.4, 10.4, told(10.4))
    assert not unit_time.jumped(10.6, 10.6, told(10.6, off_ms))
    assert unit_time.jumped(10.8, 10.8, told(10.8, off_ms))
    assert not unit_time.jumped(11.0, 11.0, told(11.0, off_ms))  # told once


def test_two_damaged_samples_that_do_not_agree_are_no_restart() -> None:
    unit_time = UnitTime()
    assert not unit_time.jumped(9.8, 9.8, told(9.8))
    assert not unit_time.jumped(10.0, 10.0, told(10.0))
    assert not unit_time.jumped(10.2, 10.2, told(10.2, 9000))
    assert not unit_time.jumped(10.4, 10.4, told(10.4, -20_000))
    assert not unit_time.jumped(10.6, 10.6, told(10.6))


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0, 10.0])
def test_an_emulated_unit_that_lives_faster_was_not_switched_off(rate: float) -> None:
    """Looked at while it streams, and left alone for as long as homing takes, before the first motion and after."""
    rng, unit_time, now_s = random.Random(3), UnitTime(), 5.0
    for gap_s in [0.1, 0.1, 0.1, 31.0 / rate, *[0.2] * 60, 12.0, *[0.2] * 60, 40.0 / rate, *[0.2] * 5]:
        now_s += gap_s
        assert not unit_time.jumped(now_s, now_s, told(rate * (now_s - rng.uniform(0.0, 0.05))))


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_a_restart_is_told_while_it_streams_whatever_the_rate(rate: float) -> None:
    unit_time = UnitTime()
    for k in range(100):
        assert not unit_time.jumped(0.2 * k, 0.2 * k, told(rate * 0.2 * k))
    assert not unit_time.jumped(20.0, 20.0, told(0.3 * rate))
    assert unit_time.jumped(20.2, 20.2, told(0.5 * rate))


@pytest.mark.parametrize("rate", [1.0, 5.0])
@pytest.mark.parametrize("late", [2.35, 4.7])
def test_a_host_that_looks_at_one_answer_late_does_not_take_the_next_two_for_a_restart(
    rate: float, late: float
) -> None:
    """Seen in the log of a busy host whose emulated unit lived five times as fast; a restart is still told."""
    unit_time, usual_s, late_s = UnitTime(), 0.5 / rate, late / rate
    for k in range(100):
        assert not unit_time.jumped(0.2 * k, 0.2 * k + usual_s, told(rate * 0.2 * k))
    assert not unit_time.jumped(20.0, 20.0 + late_s, told(rate * 20.0))
    for now_s in [20.2 + late_s, 20.4 + late_s]:
        assert not unit_time.jumped(now_s, now_s, told(rate * now_s))
    assert not unit_time.jumped(20.6 + late_s, 20.6 + late_s, told(0.3 * rate))
    assert unit_time.jumped(20.8 + late_s, 20.8 + late_s, told(0.5 * rate))
