"""Axes that do not follow their reference."""

from __future__ import annotations

import itertools

from arm.controller.unit import Unit
from driver.emulator import Fault, When
from emulated.faulty_unit import position, session, status


def test_a_stuck_axis_stays_while_the_generator_goes_on(unit: Unit) -> None:
    fault = Fault("stuck_axis", When(command="COORDMV", after_ms=400), axis="B", for_ms=8000)
    with session(unit, fault) as (emulator, client):
        client.send("COORDMV:9000,9000,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        _, _, _, a, b, *_ = position(client)
        assert a == 9000
        assert 0 < b < 3000
        assert emulator.machine.path.at[1] == 9000
        record = emulator.record().counts[:, 1]
        assert record[-1] - record[0] <= b  # the truth is what the encoders say
        client.wait_for(lambda: position(client)[4] == 9000)  # and when it is free again, it follows


def test_a_stuck_axis_never_finds_its_mark(unit: Unit) -> None:
    with session(unit, Fault("stuck_axis", axis="A")) as (emulator, client):
        client.send("HHA:", "HHB:", "RB:")
        assert client.read_until(b"!\r\n") == b"RB!\r\n"
        client.wait_for(
            lambda: emulator.now_ms() > 25_000
        )  # at 15 counts/ms it would have been there after 16.6 s
        assert status(client) == 0x10
        assert position(client)[3:5] == [0, 0]
        client.send("STOP:", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert [o == 0 for o in emulator.machine.offset[:2]] == [False, True]


def test_an_axis_creeps_away_and_homing_finds_it_again(unit: Unit) -> None:
    fault = Fault("drift", axis="E", counts_per_s=-200.0, most_counts=700)
    with session(unit, fault) as (emulator, client):
        start, *_, first, _ = position(client)
        later, *_, second, _ = position(client)
        assert second <= first <= 0
        assert abs(second - first + 0.2 * (later - start)) <= 2
        client.wait_for(lambda: position(client)[7] == -700)
        client.send("HHE:", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert position(client)[7] == emulator.counts()[4] == 0
        steps = emulator.record().counts[:, 4]
        assert max(abs(b - a) for a, b in itertools.pairwise(steps)) < 100  # it went there
