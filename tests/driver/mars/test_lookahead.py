"""Look-ahead: what noticing and stopping takes, and when a segment can begin at the earliest."""

from __future__ import annotations

import random

import pytest

from arm.controller.unit import load_unit
from driver.mars.lookahead import ANSWERS_BYTES, MARGIN_S, Needs, Timeline, braking_s, dwell_for


@pytest.mark.parametrize(("name", "seconds"), [("crs93", 0.256), ("crs97", 0.4096)])
def test_braking_is_that_of_the_slowest_axis(name: str, seconds: float) -> None:
    unit = load_unit(name)
    assert braking_s(unit.speed_registers, unit.acceleration_registers) == pytest.approx(seconds, abs=2e-3)


def test_an_arm_that_has_just_begun_to_move_brakes_sooner() -> None:
    needs = Needs(trip_s=0.1, stop_s=0.08, braking_s=0.25)
    assert needs.last_s(0.0) == pytest.approx(0.08 + MARGIN_S)
    assert needs.last_s(0.1) == pytest.approx(0.18 + MARGIN_S)
    assert needs.last_s(9.0) == pytest.approx(0.33 + MARGIN_S)
    assert needs.echo_s(96, 192) == pytest.approx(
        0.1 + 0.05 + ANSWERS_BYTES / 1920
    )  # 192 bytes are on their way
    assert needs.echo_s(96, 384) == pytest.approx(0.1 + 0.15 + ANSWERS_BYTES / 1920)  # the others wait
    assert needs.whole_s > needs.echo_s(149, 160) + 0.33 + MARGIN_S
    assert needs.window_bytes == pytest.approx(2 * 0.1 * 1920 + 200)  # two round trips, and two long segments
    assert Needs(0.0, 0.08, 0.25).window_bytes >= 160


def test_after_the_dwell_every_segment_can_be_verified_in_time() -> None:
    rng = random.Random(1)
    for _ in range(200):
        needs = Needs(rng.uniform(0.0, 0.5), rng.uniform(0.03, 0.3), rng.uniform(0.1, 0.5))
        sizes = [rng.randint(40, 150) for _ in range(40)]
        durations = [rng.uniform(0.05, 0.3) for _ in sizes]
        for preload in (False, True):
            dwell = dwell_for(needs, sizes, durations, 60, preload)
            spare = []
            back = (2 * 60 + ANSWERS_BYTES) / 1920
            sent = back + needs.trip_s  # nothing goes before the dwell has come back
            for k, size in enumerate(sizes):
                sent += size / 1920
                back = max(back, sent) + size / 1920
                moving = 0.0 if preload else sum(durations[:k])
                spare.append(dwell + moving - (back + needs.trip_s) - needs.last_s(moving))
            assert min(spare) >= -1e-9
            assert min(spare) < 1.0 if preload else min(spare) < 0.2  # the window may hold lines back


def test_a_segment_begins_no_earlier_than_all_before_it_take_and_no_earlier_than_was_seen() -> None:
    timeline = Timeline([0.1] * 10)
    timeline.stands(0, 5.0)
    assert timeline.begins(0) == 5.0
    assert timeline.begins(7) == pytest.approx(5.7)
    timeline.not_before(3, 5.1)  # sooner than it could: tells nothing
    assert timeline.begins(7) == pytest.approx(5.7)
    timeline.not_before(3, 5.9)  # the unit takes longer
    assert timeline.begins(7) == pytest.approx(6.3)
    assert timeline.moving(7) == pytest.approx(1.3)
    timeline.stands(5, 8.0)
    assert timeline.begins(5) == 8.0
    assert timeline.moving(6) == pytest.approx(0.1)
    timeline.change([0.1] * 6 + [0.4] * 4)
    assert timeline.begins(8) == pytest.approx(8.9)
