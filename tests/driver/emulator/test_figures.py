"""What the emulated unit makes of a stream of cubics, by raw bytes at 19200 baud: path, time, limits, cost.

No part of the driver is used. The figures follow from docs/sources.md, "Capacity of the line".
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit, load_unit
from arm.se3 import Array
from arms.count_paths import off_path_deg
from driver.emulator import Emulator, EmulatorOptions, Record
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from timed.relative import cost_s, interpreted
from wire.client import Client, SteppedClient

SEGMENTS, SEGMENT_MS = 60, 100
DWELL_MS = 300
ROUNDING_DEG = 0.0015  # a recorded position is a whole count: 0.0018 deg on axes D to F


def await_line(client: Client | SteppedClient, wanted: str) -> None:
    """Read until a line is exactly that; none may be FAIL!."""
    told = client.read_until(wanted.encode() + b"\r\n")
    assert b"FAIL!\r\n" not in told
    assert told.endswith(wanted.encode() + b"\r\n")


@pytest.fixture(scope="module")
def unit() -> Unit:
    return load_unit("crs93")


@pytest.fixture
def emulator(unit: Unit) -> Iterator[Emulator]:
    """Switched on with the arm at its homing marks, so that homing takes no time."""
    with Emulator(unit, SteppedClock(), options=at_marks(unit)) as emulator:
        yield emulator


def at_marks(unit: Unit) -> EmulatorOptions:
    return EmulatorOptions(power_up_deg=tuple(float(d) for d in np.degrees(unit.positions(np.zeros(6)))))


def prepare(client: Client | SteppedClient) -> None:
    """Homed, with the group formed and the vertex rule set."""
    client.send("", "ECHO:0", *(f"HH{axis}:" for axis in "ABCDEF"), "R:")
    await_line(client, "R!")
    client.send("COORDGRP:A,B,C,D,E,F", "COORDDISCONT:5", "STAMP:1")
    await_line(client, "STAMP=1")


@pytest.fixture
def terminal(emulator: Emulator) -> SteppedClient:
    terminal = SteppedClient(emulator.open_line())
    prepare(terminal)
    return terminal


def planned_curve(unit: Unit, seed: int) -> Array:
    """A random motion of all axes from the marks inwards, rest to rest, within 90 % of the speed and 50 % of the
    acceleration registers; counts at every ms, (m, 6)."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, SEGMENTS * SEGMENT_MS + 1)
    rise = 10 * t**3 - 15 * t**4 + 6 * t**5
    wave = rise * (1.0 - rise) * np.sin(np.outer(rng.uniform(3.0, 9.0, 6), t))
    curve = (rise + rng.uniform(0.2, 0.6, 6)[:, None] * wave).T
    speed, acceleration = limits(unit)
    fastest = np.abs(np.diff(curve, axis=0)).max(axis=0)
    hardest = np.abs(np.diff(curve, 2, axis=0)).max(axis=0)
    length = np.minimum(0.9 * speed / fastest, 0.5 * acceleration / hardest)
    return np.asarray(curve * length * np.sign(unit.counts(unit.soft_home)))


def limits(unit: Unit) -> tuple[Array, Array]:
    """Speed in counts/ms and acceleration in counts/ms^2 of the default registers."""
    return np.array(unit.speed_registers) / 256.0, np.array(unit.acceleration_registers) / 256.0


def to_cubics(curve: Array) -> CountPath:
    """Hermite cubics in whole counts; a1 takes the rounding, so that sums are exact."""
    slope = np.gradient(curve, axis=0)[::SEGMENT_MS] * SEGMENT_MS
    slope[[0, -1]] = 0.0
    knots = np.rint(curve[::SEGMENT_MS])
    segments = []
    for way, v0, v1 in zip(np.diff(knots, axis=0), slope[:-1], slope[1:], strict=True):
        a2, a3 = np.rint(3 * way - 2 * v0 - v1), np.rint(v0 + v1 - 2 * way)
        rows = np.stack([way - a2 - a3, a2, a3]).astype(int)
        segments.append(Segment(SEGMENT_MS, tuple(tuple(int(a) for a in row) for row in rows)))
    return CountPath((0,) * 6, tuple(segments))


def lines(path: CountPath) -> list[str]:
    """One COORDSPLINET a segment, axis by axis."""
    return [
        f"COORDSPLINET:{s.duration_ms},3,"
        + ",".join(str(a) for axis in zip(*s.coefficients, strict=True) for a in axis)
        for s in path.segments
    ]


DWELL = f"COORDSPLINET:{DWELL_MS},3," + ",".join(["0"] * 18)


def bends(counts: Array, over_ms: int = 20) -> Array:
    """Acceleration from rest to rest, counts/ms^2, as a mean over some ms: whole counts cannot tell it at one."""
    rest = np.ones((2 * over_ms, 1))
    whole = np.vstack([rest * counts[0], counts, rest * counts[-1]])
    return np.asarray(np.abs(np.diff(whole[::over_ms], 2, axis=0)) / over_ms**2)


def motion(emulator: Emulator) -> Record:
    """The record from the first coordinated ms on: homing at the mark takes one ms an axis."""
    record = emulator.record()
    return Record(record.time_ms[6:], record.counts[6:])


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_preloaded_stream_keeps_path_and_time(
    unit: Unit, emulator: Emulator, terminal: SteppedClient, seed: int
) -> None:
    curve = planned_curve(unit, seed)
    path = to_cubics(curve)
    terminal.send(DWELL, *lines(path), "R:")
    await_line(terminal, "R!")
    record = motion(emulator)
    counts = np.vstack([np.zeros(6), record.counts])
    assert np.all(np.diff(record.time_ms) == 1)
    assert tuple(int(c) for c in counts[-1]) == path.end == emulator.counts()
    assert off_path_deg(unit, counts, curve) <= 0.02
    assert off_path_deg(unit, counts, path.sample()) <= ROUNDING_DEG
    assert 6000 <= len(record.time_ms) - DWELL_MS <= 1.03 * 6000
    speed, acceleration = limits(unit)
    assert np.all(np.abs(np.diff(counts, axis=0)) <= speed + 1.0)
    assert np.all(bends(counts) <= acceleration)


def test_a_starved_stream_rests_on_the_path_and_goes_on(
    unit: Unit, emulator: Emulator, terminal: SteppedClient
) -> None:
    path = to_cubics(planned_curve(unit, 4))
    for half in (lines(path)[:30], lines(path)[30:]):
        terminal.send(*half, "R:")
        await_line(terminal, "R!")
        done = 30 if half == lines(path)[:30] else 60
        assert emulator.counts() == tuple(int(c) for c in path.knots()[done])
    counts = np.vstack([np.zeros(6), motion(emulator).counts])
    assert off_path_deg(unit, counts, path.sample()) <= ROUNDING_DEG
    # The rate may brake at the whole acceleration while the path itself bends at up to half of it (row 15).
    assert np.all(bends(counts) <= 1.5 * limits(unit)[1] + 2.0 / 20**2)


def test_stop_brakes_on_the_path(unit: Unit, emulator: Emulator, terminal: SteppedClient) -> None:
    path = to_cubics(planned_curve(unit, 5))
    terminal.send(*lines(path)[:40])
    emulator.clock.sleep(2.5)
    terminal.send("STOP:", "R:")
    await_line(terminal, "R!")
    counts = np.vstack([np.zeros(6), motion(emulator).counts])
    assert 1000 < len(counts) < 4000
    assert emulator.counts() == tuple(int(c) for c in counts[-1]) != path.end
    assert off_path_deg(unit, counts, path.sample()) <= ROUNDING_DEG
    assert np.all(bends(counts) <= 1.5 * limits(unit)[1] + 2.0 / 20**2)


def test_ten_times_real_time_costs_little(unit: Unit) -> None:
    """6 s of motion, streamed through a pseudo-terminal, at most what 50 sums of 100 000 squares take in Python.

    The client's own share included. That is 40 % of one core of 2020 at ten times real time.
    """
    path = to_cubics(planned_curve(unit, 6))
    clock = Clock(10.0)
    with Emulator(unit, clock, options=at_marks(unit)) as emulator, Client(emulator.open_pty()) as client:
        prepare(client)
        begun = clock.now()

        def streamed() -> None:
            client.send(DWELL, *lines(path), "R:")
            await_line(client, "R!")

        assert cost_s(streamed) <= 50.0 * cost_s(interpreted)
        assert clock.now() - begun >= 6.3
