"""A unit whose clock does not go on was switched off and on; one damaged sample is not that."""

from __future__ import annotations

import random

import pytest

from driver.protocol import CLOCK_RANGE_MS
from driver.unittime import SLACK_S, UnitTime


def told(now_s: float, off_ms: int = 0) -> int:
    return (round(now_s * 1e3) + off_ms) % CLOCK_RANGE_MS


def test_a_clock_that_goes_on_never_jumps_across_its_wrap_and_with_answers_that_come_late() -> None:
    rng, unit_time, now_s = random.Random(1), UnitTime(), 0.0
    for _ in range(3000):
        now_s += rng.uniform(0.05, 9.0)
        late_s = rng.uniform(0.0, 0.9 * SLACK_S)
        assert not unit_time.jumped(now_s, told(now_s - late_s))
    assert now_s * 1e3 > 100 * CLOCK_RANGE_MS


@pytest.mark.parametrize("off_ms", [2500, 30_000, -2500, CLOCK_RANGE_MS // 2])
def test_one_sample_with_a_digit_changed_is_no_restart_and_two_that_agree_are(off_ms: int) -> None:
    unit_time = UnitTime()
    assert not unit_time.jumped(9.6, told(9.6, off_ms))  # the first of all is the damaged one
    assert not unit_time.jumped(9.8, told(9.8))
    assert not unit_time.jumped(10.0, told(10.0))
    assert not unit_time.jumped(10.2, told(10.2, off_ms))
    assert not unit_time.jumped(10.4, told(10.4))
    assert not unit_time.jumped(10.6, told(10.6, off_ms))
    assert unit_time.jumped(10.8, told(10.8, off_ms))
    assert not unit_time.jumped(11.0, told(11.0, off_ms))  # told once


def test_two_damaged_samples_that_do_not_agree_are_no_restart() -> None:
    unit_time = UnitTime()
    assert not unit_time.jumped(9.8, told(9.8))
    assert not unit_time.jumped(10.0, told(10.0))
    assert not unit_time.jumped(10.2, told(10.2, 9000))
    assert not unit_time.jumped(10.4, told(10.4, -20_000))
    assert not unit_time.jumped(10.6, told(10.6))
