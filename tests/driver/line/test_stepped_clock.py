"""Stepped time: driver and emulated unit in one thread, the same to the byte whatever the host does."""

from __future__ import annotations

import math
import os
import queue
import random
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.controller.unit import Unit
from arm.errors import A465Error, ExecutionStopped
from arms.count_paths import quintic
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.memory import MemoryLine
from driver.execution.progress import Progress
from driver.line.clock import Clock
from driver.line.link import Link, NoAnswer
from driver.line.signals import interruptible
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks


def inwards(unit: Unit, start: tuple[int, ...]) -> CountPath:
    """Two seconds from the marks to the inside."""
    return quintic(start, 20, tuple(int(c) // 8 for c in unit.counts(unit.soft_home)))


def session(unit: Unit, log: Path, latency_s: float, look: Callable[[Progress], None]) -> MemoryLine:
    """Home, then two seconds of motion; the line with all its bytes."""
    clock = SteppedClock()
    options = EmulatorOptions(power_up_deg=near_marks(unit))
    with Emulator(unit, clock, options=options) as emulator, WireLog(log, clock) as wire:
        line = emulator.open_line(latency_s)
        with Mars(line, unit, clock, wire) as mars:
            mars.identify()
            mars.initialise(soft_home=False)
            stream(mars, inwards(unit, mars.counts()), look)
        assert emulator.violations == ()
    return line


@pytest.mark.parametrize("latency_s", [0.0, 0.016, 0.1, 0.2])
def test_a_stream_is_the_same_to_the_byte_and_the_instant(
    unit: Unit, tmp_path: Path, latency_s: float
) -> None:
    """Once as fast as this host can, once on a host that stops for random times."""
    delays = random.Random(7)
    quick, slow = tmp_path / "quick.jsonl", tmp_path / "slow.jsonl"
    first = session(unit, quick, latency_s, lambda _: None)
    second = session(unit, slow, latency_s, lambda _: time.sleep(delays.uniform(0.0, 0.02)))
    assert quick.read_bytes() == slow.read_bytes()
    assert (first.sent, first.received) == (second.sent, second.received)
    assert first.sent[-1][0] > 3.0


def test_a_deadline_costs_no_wall_time(emulator: Emulator, clock: SteppedClock) -> None:
    link = Link(emulator.open_line(to_unit=lambda at, data: b""), clock)
    with pytest.raises(NoAnswer, match="STAMP within 2 s"):
        link.synchronise()
    assert 2.0 <= clock.now() < 2.1
    clock.sleep(1e6)
    assert clock.now() >= 1e6
    link.close()


def test_an_event_strikes_the_driver_while_it_waits(
    emulator: Emulator, unit: Unit, clock: SteppedClock
) -> None:
    def strike() -> None:
        raise KeyboardInterrupt

    with Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise(soft_home=False)
        path = inwards(unit, mars.counts())
        clock.call_after(1.5, strike)
        with pytest.raises(ExecutionStopped, match="interrupted") as stopped:
            stream(mars, path)
        assert stopped.value.data["state"]["at_rest"]
        at = np.array(emulator.counts())
        assert np.min(np.max(np.abs(path.sample(1e-3) - at), axis=1)) <= 10.0
        assert 0 < abs(at[0] - path.start[0]) < abs(path.end[0] - path.start[0])


def test_things_happen_in_the_order_of_their_times(clock: SteppedClock) -> None:
    order: list[tuple[str, float]] = []
    clock.call_at(2.0, lambda: order.append(("late", clock.now())))
    clock.call_at(1.0, lambda: order.append(("first", clock.now())))
    clock.call_at(1.0, lambda: clock.call_at(0.5, lambda: order.append(("over", clock.now()))))
    clock.call_at(1.0, lambda: order.append(("second", clock.now())))
    clock.sleep(1.5)
    assert order == [("first", 1.0), ("over", 1.0), ("second", 1.0)]
    assert clock.now() == 1.5
    clock.sleep(0.5)
    assert order[3:] == [("late", 2.0)]


def test_what_was_ordered_comes_before_what_lives_at_the_same_time(clock: SteppedClock) -> None:
    order: list[str] = []

    class Lives:
        def __init__(self, name: str) -> None:
            self.name = name

        def next_at(self) -> float:
            return 1.0 if self.name not in order else math.inf

        def step(self) -> None:
            order.append(self.name)

    for name in ("one", "other"):
        clock.add(Lives(name))
    clock.call_at(1.0, lambda: order.append("ordered"))
    clock.sleep(1.0)
    assert order == ["ordered", "one", "other"]


def test_no_host_is_too_busy_for_stepped_time(clock: SteppedClock) -> None:
    assert clock.at_least(2.0, 100.0) == 2.0
    assert Clock(20.0).at_least(2.0, 1.0) == 20.0
    assert Clock(20.0).at_least(30.0, 1.0) == 30.0


def test_an_event_may_not_wait(clock: SteppedClock) -> None:
    clock.call_after(1.0, lambda: clock.sleep(1.0))
    with pytest.raises(A465Error, match="must not wait"):
        clock.sleep(2.0)


def test_events_without_an_end_are_told(clock: SteppedClock) -> None:
    def again() -> None:
        clock.call_after(0.0, again)

    clock.call_after(1.0, again)
    with pytest.raises(A465Error, match="at 1 s: stepped time does not advance"):
        clock.sleep(2.0)


def test_ports_of_the_host_need_a_thread_and_lines_in_memory_need_none(
    unit: Unit, emulator: Emulator
) -> None:
    with pytest.raises(A465Error, match="use open_line"):
        emulator.open_pty()
    with pytest.raises(A465Error, match="use open_line"):
        emulator.open_tcp()
    with Emulator(unit, Clock(20.0)) as other, pytest.raises(A465Error, match="SteppedClock"):
        other.open_line()


def test_what_is_looked_at_is_true_now(emulator: Emulator, unit: Unit, clock: SteppedClock) -> None:
    """Motion is executed when asked for, however long ago the last event was."""
    with Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        mars.initialise(soft_home=False)
        mars.link.send("COORDMVT:1000,1000,0,0,0,0,0")
        clock.sleep(0.1)
        seen = []
        for _ in range(40):
            clock.sleep(0.025)
            assert emulator.now_ms() == math.floor(clock.now() * 1e3 + 1e-6)
            seen.append(emulator.counts()[0])
        assert seen == sorted(seen)
        assert len(set(seen)) > 30
        clock.sleep(1.0)
        assert emulator.counts()[0] == 1000


def test_it_goes_no_faster_than_it_is_watched(unit: Unit) -> None:
    clock = SteppedClock(50.0)
    begin = time.monotonic()
    clock.sleep(10.0)
    assert time.monotonic() - begin >= 0.2
    assert clock.now() == 10.0
    time.sleep(0.3)  # a planner works: the pace begins anew
    begin = time.monotonic()
    clock.sleep(10.0)
    assert time.monotonic() - begin >= 0.2 - 0.05


def test_another_thread_may_end_a_wait_at_the_time_of_now(unit: Unit) -> None:
    clock = SteppedClock(0.01)
    items: queue.SimpleQueue[int] = queue.SimpleQueue()
    threading.Timer(0.1, items.put, (7,)).start()
    assert clock.next_of(items, 1e6) == 7
    assert clock.now() == 0.0  # nothing happened until then


def test_a_signal_waits_for_the_end_of_an_event(clock: SteppedClock) -> None:
    done: list[str] = []

    def event() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        done.append("whole")

    clock.call_after(1.0, event)
    with interruptible(), pytest.raises(KeyboardInterrupt, match="SIGINT"):
        clock.sleep(2.0)
    assert done == ["whole"]
    assert clock.now() == 1.0
    clock.sleep(1.0)
    assert clock.now() == 2.0
