"""Controller time, as fast as wall time or faster."""

from __future__ import annotations

import queue
import time

import pytest

from driver.line.clock import Clock


@pytest.mark.parametrize("scale", [1.0, 20.0])
def test_waits_are_in_controller_seconds(scale: float) -> None:
    begun, clock = time.monotonic(), Clock(scale)
    before = clock.now()
    clock.sleep(0.02 * scale)
    with pytest.raises(queue.Empty):
        clock.next_of(queue.SimpleQueue(), clock.now() + 0.02 * scale)
    taken = clock.now() - before
    assert 0.04 * scale <= taken <= (time.monotonic() - begun) * scale
    assert clock.wall(3.0) == 3.0 / scale
    assert clock.at_least(0.5, 1.0) == scale
    assert clock.at_least(50.0, 1.0) == 50.0


def test_what_is_there_is_taken_though_its_time_is_over() -> None:
    items: queue.SimpleQueue[str] = queue.SimpleQueue()
    items.put("line")
    clock = Clock()
    assert clock.next_of(items, clock.now() - 1.0) == "line"


def test_the_counter_of_a_later_program_is_higher() -> None:
    first = Clock().unique_ms()
    time.sleep(0.002)
    assert Clock().unique_ms() > first
