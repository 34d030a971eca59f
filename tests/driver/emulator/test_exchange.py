"""Lines and answers between clients and the emulated unit: in order, and nothing unasked."""

from __future__ import annotations

import pytest

from arm.controller.unit import Unit
from emulated.connected_unit import connected


def test_2_nothing_is_said_unasked(unit: Unit) -> None:
    with connected(unit) as (emulator, client):
        client.send("HHB:", "GA:3000", "RA:", "FOO:1", "COORDGRP:A,B", "STAMP:7")
        assert client.read_until(b"RA!\r\n") == b"STAMP=7\r\nRA!\r\n"
        emulator.set_power(False)
        emulator.set_power(True)
        assert client.read_for(10.0) == b""


def test_3_many_waits_of_several_axes_end_in_the_order_of_the_axes_ends(unit: Unit) -> None:
    with connected(unit) as (_, client):
        client.send("GA:9000", "GB:300", "R:", "RA:", "RB:", "RA:", "STAMP:1", "RC:")
        told = client.read_until(b"RA!\r\nRA!\r\n").decode().split()
        assert told[:3] == ["STAMP=1", "RC!", "RB!"]
        assert sorted(told[3:]) == ["R!", "RA!", "RA!"]


def test_7_an_answer_may_take_its_time(unit: Unit) -> None:
    with connected(unit, reply_delay_ms=400.0) as (emulator, client):
        begin = emulator.clock.now()
        client.send("STAMP:1", "STAMP:2")
        assert client.read_until(b"=2\r\n") == b"STAMP=1\r\nSTAMP=2\r\n"
        # each is late, one not behind the other
        assert emulator.clock.now() - begin == pytest.approx(0.4 + (16 + 9) / 1920.0, abs=5e-3)
