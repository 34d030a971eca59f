"""Whatever comes down the line, for however long, the emulated unit neither falls over nor grows."""

from __future__ import annotations

import gc
import random
import threading
import tracemalloc
from array import array

import hypothesis.strategies as st
import numpy as np
from hypothesis import example, given, settings

from arm.controller.unit import Unit, load_unit
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.commands import Interpreter
from driver.emulator.unit.machine import Machine
from driver.emulator.unit.record import Recorder
from driver.line.clock import Clock
from wire.client import Client

UNIT = load_unit("crs93")
NAMES = [
    "ECHO", "STAMP", "VER", "ST", "R", "RA", "RG", "APA", "APG", "APH", "GA", "GG", "SPDA", "SPDTB", "PWMA", "HHA",
    "HHG", "STOP", "STOPA", "RELEASE", "RELEASEG", "PURGE", "PURGEB", "REGMSA", "REGACCA", "REGMSG", "COORDGRP",
    "COORDDISCONT", "COORDISCONT", "COORDMV", "COORDMVT", "COORDRELMVT", "COORDSPLINET", "COORDAP", "IDLEREL",
]  # fmt: skip
numbers = st.one_of(
    st.integers(-(2**31), 2**31), st.integers(-100, 100), st.floats(), st.sampled_from(["", "A", "-", "1e9"])
)
lines = st.one_of(
    st.builds(
        lambda name, mark, values: name + mark + ",".join(map(str, values)),
        st.sampled_from(NAMES),
        st.sampled_from([":", "?", "?:", "", "::"]),
        st.lists(numbers, max_size=22),
    ),
    st.builds(
        lambda ms, order, rows: f"COORDSPLINET:{ms},{order}," + ",".join(map(str, rows[: 6 * order])),
        st.integers(0, 3000),
        st.integers(1, 4),
        st.lists(st.integers(-(2**31) + 1, 2**31 - 1), min_size=24, max_size=24),
    ),
    st.sampled_from(["COORDGRP:A,B,C,D,E,F", "REGMSA:2147483647", "REGACCA:2147483647", "SPDA:8388607"]),
    st.binary(max_size=40).map(lambda data: data.decode("latin-1")),
)


@example(
    [(f"REG{name}A:2147483647", 0) for name in ("MS", "ACC")]
    + [("COORDRELMVT:1,2147483647,0,0,0,0,0", 900)] * 2
)
@example([("GA:nan", 1), ("COORDMV:inf,0,0,0,0,0", 1), ("SPDA:1e300", 1), ("REGMSA:nan", 1)])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(st.lists(st.tuples(lines, st.integers(0, 60)), max_size=40))
def test_any_lines_at_any_time_leave_a_unit_that_answers(script: list[tuple[str, int]]) -> None:
    unit = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=50, keep_ms=100)))
    unit.take("COORDGRP:A,B,C,D,E,F")
    for line, ms in script:
        for answer in unit.take(line):
            assert answer.isascii()
            assert "\n" not in answer
        unit.machine.run(ms)
        unit.ready()
    (status,) = unit.take("ST?")[:1]
    assert 0 <= int(status.removeprefix("ST=")) < 2**18
    unit.take("STOP:")
    unit.machine.run(10)
    assert unit.take("STAMP:5")[0] == "STAMP=5"
    assert len(unit.lines) <= 50
    assert len(unit.machine.recorder) <= 113


def rubbish(seed: int, size: int) -> bytes:
    """Random bytes, and lines that were once valid."""
    rng = random.Random(seed)
    valid = [b"VER?", b"R:", b"COORDAP?", b"COORDRELMVT:20,90,0,0,0,0,-90", b"GA:%d" % rng.randrange(9999), b"ST?",
             b"COORDGRP:A,B,C,D,E,F", b"STAMP:77", b"FOO:1", b"HHA:", b"STOP:", b"SPDB:900"]  # fmt: skip
    parts = []
    have = 0
    while have < size:
        if rng.random() < 0.3:
            part = rng.randbytes(rng.randrange(1, 200))
        else:
            line = bytearray(rng.choice(valid) + b"\n")
            if rng.random() < 0.2:
                line[rng.randrange(len(line))] = rng.randrange(256)
            part = bytes(line)
        parts.append(part)
        have += len(part)
    return b"".join(parts)[:size]


def test_a_million_random_bytes_neither_stop_nor_fatten_it(unit: Unit) -> None:
    options = EmulatorOptions(paced=False, keep_lines=500, keep_ms=2000)
    held = []
    with Emulator(unit, Clock(1.0), options=options) as emulator:
        for seed, size in enumerate((800_000, 100_000, 100_000)):
            with Client(emulator.open_tcp()) as client:
                data = rubbish(seed, size) + b"\nECHO:0\nPURGE:\nSTOP:\nSTAMP:4321\n"
                writer = threading.Thread(target=client.write_all, args=(data,))
                writer.start()
                told = client.drain_until(b"STAMP=4321\r\n", 60.0)
                writer.join(10.0)
                assert b"STAMP=4321\r\n" in told  # waits of before may end behind it
            assert emulator.failure is None
            gc.collect()
            if seed:
                held.append(tracemalloc.get_traced_memory()[0])
            else:
                tracemalloc.start()  # from here on: it makes everything slow
        tracemalloc.stop()
        assert len(emulator.lines) == 500
        assert len(emulator.record().time_ms) <= 2251
    assert held[1] - held[0] < 50_000  # of 100,000 bytes that came between


def test_a_flood_of_questions_on_a_slow_line_holds_the_host_back(unit: Unit) -> None:
    """Five bytes in, forty out: an unbounded unit would owe eight times as much as it was asked."""
    with Emulator(unit, Clock(20.0)) as emulator, Client(emulator.open_pty()) as client:
        client.send("ECHO:0")
        client.read_until(b"ECHO:0\n")
        client.write(b"VER?\n" * 600)
        (wire,) = emulator._ports.wires
        most = 0
        told = b""
        while told.count(b"\n") < 600:
            told += client.read_for(0.02)
            most = max(most, sum(len(data) for _, data in list(wire._answers)))
        assert most < 6000  # of 24,000: the limit and what had been read when it was reached
        assert told == f"VER={EmulatorOptions().version}\r\n".encode() * 600


def test_a_record_keeps_the_newest_in_step() -> None:
    recorder = Recorder(2, keep=100)
    for ms in range(1000):
        recorder.add(ms, (ms, -ms))
    record = recorder.record()
    assert 100 <= len(record.time_ms) <= 113
    assert record.time_ms[-1] == 999
    assert np.array_equal(record.counts[:, 0], record.time_ms)
    assert np.array_equal(record.counts[:, 1], -record.time_ms)
    everything = Recorder(2)
    for ms in range(1000):
        everything.add(ms, (ms, 2**40))
    assert len(everything) == 1000
    assert everything.record().counts[5].tolist() == [5, 2**31 - 1]
    assert array("i").itemsize == 4


def test_what_is_remembered_is_bounded_unless_all_is_asked_for() -> None:
    bounded = Interpreter(Machine(UNIT, None, EmulatorOptions()))
    assert bounded.lines.maxlen == bounded.ignored.maxlen == bounded.machine.violations.maxlen == 100_000
    everything = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=None, keep_ms=None)))
    assert everything.lines.maxlen is None
    few = Interpreter(Machine(UNIT, None, EmulatorOptions(keep_lines=3)))
    for number in range(10):
        few.take(f"FOO:{number}")
        few.machine.violate(str(number))
    assert [text for _, text in few.ignored] == ["FOO:7", "FOO:8", "FOO:9"]
    assert [violation.what for violation in few.machine.violations] == ["7", "8", "9"]
    assert few.machine.violated == 10
