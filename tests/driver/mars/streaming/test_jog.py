"""Steps that keys ask for, at the wire: at rest soon after the last key, on the steps alone, not on a bad line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arm.errors import ExecutionStopped, InputError
from driver.emulator import Fault, When
from driver.mars.streaming.jog import REST_S
from emulated.jogged import Jogged, jogged

AT_DEG = (-57.0, -40.0, -80.0, 0.0, -60.0, 5.0)
ALLOWED_S = 0.4  # from the last key to the arm at rest


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


def _by(unit: Unit, joint: int, deg: float) -> tuple[int, ...]:
    by = np.zeros(6)
    by[joint] = deg * np.pi / 180.0
    return tuple(int(c) for c in np.rint(by * unit.counts_per_rad))


def _typed(made: Jogged, times: Sequence[float], by: tuple[int, ...], name: str) -> list[float]:
    """Ask for a step at each of these times; return those at which one was sent."""
    sent = []
    for at in times:
        made.clock.call_at(at, made.mars.link.wake)
        while made.clock.now() < at:
            made.jog.serve(at)
        if made.jog.step(by, name, at):
            sent.append(at)
    return sent


@pytest.mark.parametrize("seed", range(4))
def test_the_arm_rests_in_time_after_every_key_where_the_steps_end(unit: Unit, seed: int) -> None:
    rng = np.random.default_rng(seed)
    with jogged(unit, AT_DEG) as made:
        expected, sent = np.array(made.jog.end), 0
        for _ in range(12):
            joint, deg = rng.integers(6), rng.choice([0.02, 0.05, 0.1]) * rng.choice([-1, 1])
            by = _by(unit, joint, deg)
            begin = made.clock.now() + 0.05
            times = np.cumsum([begin, *rng.choice([0.03, 0.04, 0.1, 0.25], rng.integers(1, 25))])
            done = _typed(made, times.tolist(), by, f"{joint}{deg}")
            made.serve(times[-1] + REST_S)
            assert done, "a key at rest always moves the arm"
            assert made.rests_at() - times[-1] <= ALLOWED_S
            expected, sent = expected + len(done) * np.array(by), sent + len(done)
            assert made.emulator.counts() == tuple(expected) == made.jog.finish()
        assert made.jog.steps == sent
        assert made.emulator.violations == ()


def test_a_press_moves_one_step_and_a_held_key_goes_on(unit: Unit) -> None:
    by = _by(unit, 0, 0.1)
    with jogged(unit, AT_DEG) as made:
        begin, start = made.clock.now() + 0.1, made.jog.end
        assert _typed(made, [begin], by, "+") == [begin]
        made.serve(begin + 1.0)
        assert made.emulator.counts() == (start[0] + by[0], *start[1:])
        begin = made.clock.now() + 0.1
        done = _typed(made, (begin + np.arange(0.0, 2.0, 1 / 30)).tolist(), by, "+")
        made.serve(made.clock.now() + 1.0)
        moved_ms = made.emulator.record().time_ms
        while_held = moved_ms[moved_ms > 1e3 * begin]
        assert len(done) > 20
        assert np.diff(while_held).max() <= 15  # without a rest between the steps, which take 60 ms


def test_another_direction_begins_after_a_rest_and_in_time(unit: Unit) -> None:
    with jogged(unit, AT_DEG) as made:
        begin = made.clock.now() + 0.1
        _typed(made, [begin], _by(unit, 0, 0.05), "+")
        for late in np.arange(0.2, 0.6, 0.02):
            _typed(made, [begin + late], _by(unit, 1, 0.02), f"J2{late}")
        made.serve(begin + 1.0)
        assert made.rests_at() - (begin + late) <= ALLOWED_S
        at = made.emulator.record().counts
        assert not (np.diff(at, axis=0) != 0)[:, :2].all(axis=1).any()  # never both joints in one ms


def test_a_step_that_would_end_too_late_is_not_sent(unit: Unit) -> None:
    with jogged(unit, AT_DEG) as made:
        start, now = made.jog.end, made.clock.now()
        assert not made.jog.step(_by(unit, 1, 2.0), "+", now)
        assert not made.jog.step(_by(unit, 0, 0.02), "+", now - REST_S)  # a key that was read late
        made.serve(now + 1.0)
        assert made.emulator.counts() == start == made.jog.end


@pytest.mark.parametrize("seed", range(6))
def test_no_damaged_step_begins(unit: Unit, seed: int) -> None:
    nth, noise = 1 + seed % 3, Fault("garbled_bytes", When(command="COORDMVT"), direction="to_unit")
    fault = replace(noise, when=When(command="COORDMVT", nth=nth), probability=0.02, seed=seed, for_ms=400.0)
    by = _by(unit, 0, 0.1)

    starts: list[tuple[int, ...]] = []

    def held(made: Jogged) -> None:
        starts.append(made.jog.end)
        _typed(made, (made.clock.now() + np.arange(0.1, 3.0, 1 / 30)).tolist(), by, "+")
        made.serve(made.clock.now() + 1.0)

    with pytest.raises(ExecutionStopped) as stopped, jogged(unit, AT_DEG, fault) as made:
        held(made)
    start = starts[0]
    assert stopped.value.data["reason"] == "line"
    assert stopped.value.data["state"]["at_rest"]
    at = made.emulator.record().counts
    low, high = np.minimum(start, made.jog.end), np.maximum(start, made.jog.end)
    assert (at >= low).all()
    assert (at <= high).all()


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (Fault("motion_stop", When(after_ms=400.0)), "fault"),
        (Fault("lost_bytes", When(after_ms=400.0), direction="to_host", probability=1.0), "silent"),
        (
            Fault("drift", When(after_ms=400.0), axis="C", counts_per_s=4000.0, most_counts=3000.0),
            "following",
        ),
    ],
)
def test_a_fault_stops_it_also_at_rest(unit: Unit, fault: Fault, reason: str) -> None:
    with pytest.raises(ExecutionStopped) as stopped, jogged(unit, AT_DEG, fault) as made:
        made.serve(made.clock.now() + 10.0)
    assert stopped.value.data["reason"] == reason


def test_a_unit_that_does_not_echo_is_refused(unit: Unit) -> None:
    with pytest.raises(InputError, match="does not echo"), jogged(unit, AT_DEG, options={"echo": "none"}):
        pass
