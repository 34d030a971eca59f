"""Whatever comes down the line, for however long, the emulated unit neither falls over nor grows."""

from __future__ import annotations

import gc
import random
import threading
import time
import tracemalloc

import pytest

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.clock import Clock
from wire.client import Client


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


@pytest.mark.slow
def test_half_a_million_random_bytes_neither_stop_nor_fatten_it(unit: Unit) -> None:
    options = EmulatorOptions(paced=False, keep_lines=500, keep_ms=2000)
    held = []
    with Emulator(unit, Clock(1.0), options=options) as emulator:
        for seed, size in enumerate((300_000, 100_000, 100_000)):
            with Client(emulator.open_tcp()) as client:
                data = rubbish(seed, size) + b"\nECHO:0\nPURGE:\nSTOP:\nSTAMP:4321\n"
                writer = threading.Thread(target=client.write_all, args=(data,))
                writer.start()
                told = client.drain_until(b"STAMP=4321\r\n", 60.0)
                writer.join(600.0)
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
    assert held[1] - held[0] < 75_000  # 30,000 to 51,000 as measured, of 100,000 bytes that came between


def test_a_flood_of_questions_on_a_slow_line_holds_the_host_back(unit: Unit) -> None:
    """Five bytes in, forty out: an unbounded unit would owe eight times as much as it was asked."""
    with Emulator(unit, Clock(20.0)) as emulator, Client(emulator.open_pty()) as client:
        client.send("ECHO:0")
        client.read_until(b"ECHO:0\n")
        client.write(b"VER?\n" * 600)
        (wire,) = emulator._ports.wires
        most = 0
        told = b""
        deadline = time.monotonic() + 120.0
        while told.count(b"\n") < 600 and time.monotonic() < deadline:
            told += client.read_for(0.02)
            most = max(most, sum(len(data) for _, data in list(wire._answers)))
        assert most < 6000  # of 24,000: the limit and what had been read when it was reached
        assert told == f"VER={EmulatorOptions().version}\r\n".encode() * 600
