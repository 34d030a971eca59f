"""Pauses and overrides on the emulated unit, judged by what its arm did in every millisecond."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped
from arms.count_paths import distance_deg, sweep
from driver.emulator import Emulator
from driver.execution.control import Control
from driver.execution.progress import Progress
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream


@pytest.fixture
def mars(emulated_mars: Mars) -> Mars:
    return emulated_mars


def executed_since(emulator: Emulator, time_ms: int) -> np.ndarray:
    """Counts in every millisecond, (m, 6)."""
    record = emulator.record()
    return np.asarray(record.counts[record.time_ms >= time_ms])


def test_a_pause_keeps_the_path_in_every_millisecond(mars: Mars, emulator: Emulator, unit: Unit) -> None:
    path, control = sweep(unit, mars.counts(), fraction=0.8), Control()
    begin, stood, asked = emulator.now_ms(), [], []

    def script(progress: Progress) -> None:
        if progress.done >= 25 and not asked:
            asked.append(emulator.now_ms())
            control.pause()
        if control.standing:
            stood.append(emulator.now_ms())
            if stood[-1] > stood[0] + 3000:
                control.go_on()

    sent = stream(mars, path, script, None, control)
    assert sent.path == path
    assert sent.end_counts == path.end == emulator.counts()
    assert distance_deg(unit, executed_since(emulator, begin), path) <= 0.02
    record = emulator.record()
    while_standing = (record.time_ms >= stood[0]) & (record.time_ms < stood[0] + 3000)
    before = record.counts[record.time_ms < stood[0]][-1]  # milliseconds at rest need not be in the record
    assert (record.counts[while_standing] == before).all()
    assert any(np.array_equal(before, knot) for knot in path.knots())
    assert record.time_ms[-1] > stood[0] + 3000
    assert stood[0] - asked[0] < 1000 * (1.5 + 1.5)  # the look-ahead, braking, and two looks
    assert emulator.violations == ()


@pytest.mark.parametrize("override", [0.85, 0.4])
def test_an_override_keeps_the_path_and_takes_its_time(
    mars: Mars, emulator: Emulator, unit: Unit, override: float
) -> None:
    path = sweep(unit, mars.counts(), 3.0, fraction=0.8)
    begin = emulator.now_ms()
    sent = stream(mars, path, control=Control(override))
    assert distance_deg(unit, executed_since(emulator, begin), path) <= 0.02
    assert path.duration_s / override <= sent.duration_s < path.duration_s / override + 0.2
    assert sent.end_counts == path.end
    assert emulator.violations == ()


def test_a_slower_speed_asked_for_in_a_pause_is_that_of_what_is_left(
    mars: Mars, emulator: Emulator, unit: Unit
) -> None:
    path, control = sweep(unit, mars.counts(), fraction=0.8), Control()
    begin, said = emulator.now_ms(), []

    def script(progress: Progress) -> None:
        said.append(progress.override)
        if progress.done >= 20 and not control.paused and control.override == 1.0:
            control.pause()
            control.override = 0.5
        if control.standing:
            control.go_on()

    sent = stream(mars, path, script, None, control)
    longer = [b.duration_ms / a.duration_ms for a, b in zip(path.segments, sent.path.segments, strict=True)]
    change = longer.index(2.0)
    assert 20 <= change < 45
    assert longer == [1.0] * change + [2.0] * (len(longer) - change)
    assert [s.coefficients for s in sent.path.segments] == [s.coefficients for s in path.segments]
    assert (said[0], said[-1]) == (1.0, 0.5)
    assert distance_deg(unit, executed_since(emulator, begin), path) <= 0.02
    assert sent.duration_s >= sent.path.duration_s
    assert sent.end_counts == path.end == emulator.counts()
    assert emulator.violations == ()


def test_an_abort_in_full_motion_leaves_a_state_that_is_known(
    mars: Mars, emulator: Emulator, unit: Unit
) -> None:
    path, control = sweep(unit, mars.counts(), fraction=0.8), Control()
    asked: list[int] = []

    def script(progress: Progress) -> None:
        if progress.done >= 25 and not asked:
            asked.append(emulator.now_ms())
            control.abort()

    with pytest.raises(ExecutionStopped) as stopped:
        stream(mars, path, script, None, control)
    state = stopped.value.data["state"]
    assert state["at_rest"] is True
    assert tuple(state["counts"]) == emulator.counts()
    stops = [time_ms for time_ms, line in emulator.lines if line == "STOP:" and time_ms >= asked[0]]
    assert np.all(np.diff(stops) <= 60)  # until the arm stands
    assert stops[0] - asked[0] < 100
    assert not [line for time_ms, line in emulator.lines if time_ms > stops[0] and line.startswith("COORDS")]
