"""The driver and the emulated controller in stepped time: a whole session, judged by what the arm did."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from arm.controller.segments import CountPath
from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.plan_file import GripperStep, Move
from arms.count_paths import OBJECT_ADC, Jaws, distance_deg, sweep
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.execution.execute import execute
from driver.execution.progress import Progress, StreamOptions
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from emulated.near_marks import near_marks

STRICT = EmulatorOptions(unknown="fail", noise=b"\x00\xff\x80\xfeMARS", registers_readable=True)


@pytest.fixture
def emulator(unit: Unit, clock: SteppedClock) -> Iterator[Emulator]:
    with Emulator(unit, clock, Jaws(), replace(STRICT, power_up_deg=near_marks(unit))) as emulator:
        yield emulator


@pytest.fixture
def mars(emulated_mars: Mars) -> Mars:
    return emulated_mars


def executed_since(emulator: Emulator, time_ms: int) -> tuple[np.ndarray, np.ndarray]:
    record = emulator.record()
    rows = record.time_ms >= time_ms
    return record.time_ms[rows], record.counts[rows]


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["crs93", "crs97"])
def test_a_session_from_power_up_to_a_gripped_object(name: str, clock: SteppedClock, tmp_path: Path) -> None:
    unit = load_unit(name)
    with (
        Emulator(unit, clock, options=STRICT) as emulator,
        WireLog(tmp_path / "wire.jsonl", clock) as log,
        Mars(emulator.open_line(), unit, clock, log) as mars,
    ):
        assert mars.identify().startswith("MARS8")
        mars.initialise()
        home = tuple(int(c) for c in unit.counts(unit.soft_home))
        assert mars.counts() == home == emulator.counts()
        target = tuple(c + 2000 for c in home)
        assert mars.move_to(target) == target
        path = sweep(unit, target, seconds=3.0)
        seen: list[Progress] = []
        sent = stream(mars, path, seen.append)
        assert sent.path == path
        assert sent.end_counts == path.end == emulator.counts()
        assert [p.done for p in seen] == sorted(p.done for p in seen)
        assert not mars.gripper(1.0).stalled
        assert emulator.violations == ()
    assert "FAIL!" not in (tmp_path / "wire.jsonl").read_text()


def test_a_homing_line_that_is_lost_stops_where_the_unit_echoes(unit: Unit, clock: SteppedClock) -> None:
    lost = Fault("lost_bytes", When(command="COORDAP"), direction="to_unit", line=1)
    with (
        Emulator(unit, clock, options=EmulatorOptions(faults=(lost,))) as emulator,
        Mars(emulator.open_line(), unit, clock) as mars,
    ):
        mars.identify()
        with pytest.raises(ExecutionStopped, match="sent 'HHB:', no echo; the arm has stopped"):
            mars.initialise(soft_home=False)


def test_a_homing_line_that_is_lost_is_made_good_where_it_does_not(unit: Unit, clock: SteppedClock) -> None:
    """The unit reads 0 where it was switched on, so without a look at the motion it would pass for homed."""
    # the line behind the first question where the arm stands
    lost = Fault("lost_bytes", When(command="COORDAP"), direction="to_unit", line=1)
    with Emulator(unit, clock, options=EmulatorOptions(faults=(lost,), echo="none")) as emulator:
        with Mars(emulator.open_line(), unit, clock) as mars:
            mars.identify()
            mars.initialise(soft_home=False)
        assert emulator.machine.offset == (0,) * 6
        told = [line for _, line in emulator.lines if line.startswith("HH")]
        assert told.count("HHD:") == 1  # it was seen to move


def test_an_axis_that_leaves_its_mark_while_others_are_homed_is_told(unit: Unit, clock: SteppedClock) -> None:
    creeps = Fault("drift", When(command="HHD"), axis="B", counts_per_s=20_000.0, most_counts=6000)
    with (
        Emulator(unit, clock, options=EmulatorOptions(faults=(creeps,))) as emulator,
        Mars(emulator.open_line(), unit, clock) as mars,
    ):
        mars.identify()
        with pytest.raises(ExecutionStopped, match=r"axis B reads \d+ counts at its mark|does not settle"):
            mars.initialise(soft_home=False)


def test_the_arm_keeps_the_path_and_the_time(mars: Mars, emulator: Emulator, unit: Unit) -> None:
    path = sweep(unit, mars.counts())
    begin = emulator.now_ms()
    sent = stream(mars, path)
    times, counts = executed_since(emulator, begin)
    assert distance_deg(unit, counts, path) <= 0.02
    moving = np.flatnonzero(np.any(counts != counts[0], axis=1))
    duration = (times[moving[-1]] - times[moving[0]]) / 1e3
    assert duration <= 1.01 * path.duration_s
    assert sent.ahead_s <= 1.5


def test_a_host_stall_of_half_a_second_costs_nothing(
    mars: Mars, emulator: Emulator, unit: Unit, clock: SteppedClock
) -> None:
    path = sweep(unit, mars.counts(), seconds=4.0)
    asleep: list[int] = []

    def stall(progress: Progress) -> None:
        if progress.done >= 15 and not asleep:
            asleep.append(progress.done)
            clock.sleep(0.5)

    begin = emulator.now_ms()
    stream(mars, path, stall)
    times, counts = executed_since(emulator, begin)
    moving = np.flatnonzero(np.any(counts != counts[0], axis=1))
    assert asleep
    assert (times[moving[-1]] - times[moving[0]]) / 1e3 <= 1.02 * path.duration_s


def test_an_interrupt_in_a_stream_is_a_stop_in_a_tenth_of_a_second(unit: Unit, clock: SteppedClock) -> None:
    with (
        Emulator(unit, clock, options=EmulatorOptions(homing_speed=1.0)) as emulator,
        Mars(emulator.open_line(), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise()
        path = sweep(unit, mars.counts())
        pressed: list[float] = []

        def press(progress: Progress) -> None:
            if progress.done >= 20 and not pressed:
                pressed.append(emulator.now_ms())
                clock.call_after(0.01, lambda: os.kill(os.getpid(), signal.SIGINT))

        begin = emulator.now_ms()
        with pytest.raises(
            ExecutionStopped, match="interrupted; the arm has stopped and is still under power"
        ) as stopped:
            stream(mars, path, press)
        times, counts = executed_since(emulator, begin)
        state = stopped.value.data["state"]
        assert tuple(state["counts"]) == emulator.counts()
        assert distance_deg(unit, counts, path) <= 0.02
        # brakes from full speed take up to 0.26 s on this unit (its axis C); the order to brake, at most 0.1 s
        moved = np.flatnonzero(np.any(np.diff(counts, axis=0) != 0, axis=1))
        assert times[moved[-1]] - pressed[0] < 100 + 260
        # and it can go on from there, anchored, not by replaying what is left
        back = sweep(unit, mars.counts(), seconds=1.0, fraction=0.2)
        assert stream(mars, back).end_counts == back.end


def test_a_homing_that_is_interrupted_leaves_an_arm_that_must_be_homed(
    unit: Unit, clock: SteppedClock
) -> None:
    """Its counters look like positions: no other command may take them for such."""
    options = EmulatorOptions(homing_speed=0.2)
    with Emulator(unit, clock, options=options) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
        mars.identify()
        clock.call_after(8.0, lambda: os.kill(os.getpid(), signal.SIGINT))
        with pytest.raises(
            ExecutionStopped, match="homing interrupted; the arm has stopped, its position is lost"
        ):
            mars.initialise()
        with pytest.raises(ImpossibleError, match="as after power-up or an interrupted homing"):
            mars.initialise(home=False)
        mars.initialise()
        mars.initialise(home=False)


def test_a_plan_runs_and_the_object_is_felt(mars: Mars, emulator: Emulator, unit: Unit) -> None:
    path = sweep(unit, mars.counts(), seconds=2.0)
    steps = [
        GripperStep("open", "open", None, 0.0, 0.2),
        Move("over", "transit", None, path, None, 0.05, 0.01, ("a", "b")),
        GripperStep("close", "close", 0, 1.0, 0.2),
    ]
    results = execute(mars, steps)
    assert results[1].sent is not None
    assert results[1].sent.end_counts == path.end
    assert results[2].gripper is not None
    assert results[2].gripper.stalled
    assert abs(results[2].gripper.adc - OBJECT_ADC) <= 1


def split(path: CountPath, *at: int) -> list[Move]:
    """A motion cut into moves at segments: they meet at whatever speed it has there."""
    bounds = [0, *at, len(path.segments)]
    knots = path.knots()
    return [
        Move(
            f"part {k}",
            "transit",
            0,
            CountPath(tuple(int(c) for c in knots[a]), path.segments[a:b]),
            None,
            0.05,
            0.01,
            ("a", "b"),
        )
        for k, (a, b) in enumerate(pairwise(bounds))
    ]


def test_moves_that_meet_at_speed_run_without_a_stop(mars: Mars, emulator: Emulator, unit: Unit) -> None:
    path = sweep(unit, mars.counts(), seconds=4.0)
    moves = split(path, 9, 28)
    seen: list[Progress] = []
    begin = emulator.now_ms()
    results = execute(mars, moves, on_progress=seen.append, options=StreamOptions(watch_jaws=True))
    times, counts = executed_since(emulator, begin)
    assert emulator.violations == ()
    assert distance_deg(unit, counts, path) <= 0.02
    moving = np.flatnonzero(np.any(counts != counts[0], axis=1))
    assert (times[moving[-1]] - times[moving[0]]) / 1e3 <= 1.02 * path.duration_s
    top = np.array(unit.speed_registers) / 256.0  # counts/ms
    for before, after in pairwise(moves):
        assert before.path.end == after.path.start
        passed = int(np.argmin(np.abs(counts - np.array(after.path.start)).max(axis=1)))
        planned = np.abs(after.path.segments[0].derivative(0.0)) / 1e3
        speed = np.abs(counts[passed + 10] - counts[passed - 10]) / 20.0
        assert speed == pytest.approx(planned, rel=0.1, abs=0.2)
        assert (speed / top).max() > 0.5
    total = sum(r.sent.duration_s for r in results if r.sent is not None)
    assert 0.99 * path.duration_s <= total <= 1.05 * path.duration_s
    assert [r.sent.path for r in results if r.sent is not None] == [m.path for m in moves]
    assert abs(results[1].sent.duration_s - moves[1].path.duration_s) < 0.2  # type: ignore[union-attr]
    assert {p.jaws for p in seen} <= {None, 0.0}
    assert seen[-1].jaws == 0.0


def test_a_wrong_unit_is_refused(unit: Unit, clock: SteppedClock) -> None:
    options = EmulatorOptions(version="LX_RoCoN 2.1")
    with (
        Emulator(unit, clock, options=options) as emulator,
        Mars(emulator.open_line(), unit, clock) as mars,
        pytest.raises(InputError, match=r"firmware .LX_RoCoN 2\.1. is not MARS8"),
    ):
        mars.identify()


def test_a_cut_cable_moves_the_arm_no_further_than_the_look_ahead(
    emulator: Emulator, unit: Unit, clock: SteppedClock
) -> None:
    """The unit plays out what it holds and comes to rest on the path; the driver says that it cannot know."""
    cut: list[int] = []

    def pull(progress: Progress) -> None:
        if progress.done >= 20 and not cut:
            cut.append(emulator.now_ms())
            line.hang_up()

    line = emulator.open_line()
    with Mars(line, unit, clock) as mars:
        mars.identify()
        mars.initialise()
        path = sweep(unit, mars.counts())
        begin = emulator.now_ms()
        with pytest.raises(ExecutionStopped, match=r"the link is lost.*MAY STILL BE MOVING") as stopped:
            stream(mars, path, pull)
    assert stopped.value.data["ahead_s"] <= 1.5
    clock.sleep(3.0)
    times, counts = executed_since(emulator, begin)
    moved = np.flatnonzero(np.any(np.diff(counts, axis=0) != 0, axis=1))
    assert times[moved[-1]] - cut[0] < 1500 + 300
    assert distance_deg(unit, counts, path) <= 0.02
