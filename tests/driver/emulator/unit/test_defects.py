"""Defects of the unit: early or failed answers, a smaller queue, jaws that miss."""

from __future__ import annotations

from arm.controller.unit import Unit
from driver.emulator import Fault, When
from emulated.faulty_unit import position, session, status


def test_a_fail_takes_the_place_of_ready(unit: Unit) -> None:
    with session(unit, Fault("fail_reply", When(command="R", nth=2))) as (emulator, client):
        assert client.ask("R:") == "R!"
        assert client.ask("RA:") == "FAIL!"
        assert status(client) == 0
        assert client.ask("R:") == "R!"
        client.send("GA:20000", "R:", "STAMP:5")
        assert client.read_until(b"=5\r\n") == b"STAMP=5\r\n"
        emulator.inject(Fault("fail_reply"))  # one that is waited for fails at once
        assert client.read_until(b"!\r\n") == b"FAIL!\r\n"
        assert status(client) == 0x10


def test_ready_may_come_before_the_motion_has_ended(unit: Unit) -> None:
    with session(unit, Fault("early_ready", When(command="R"))) as (_, client):
        client.send("COORDMV:9000,0,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert status(client) == 0x10
        assert client.ask("R:") == "R!"
        assert position(client)[3] == 9000


def test_ready_may_come_before_the_arm_has_settled(unit: Unit) -> None:
    with session(unit, Fault("lag", lag_ms=400)) as (_, client):
        client.send("COORDMV:9000,0,0,0,0,0", "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert status(client) == 0
        assert position(client)[3] < 8990
        client.wait_for(lambda: position(client)[3] == 9000)


def test_jaws_miss_what_is_there_once(unit: Unit) -> None:
    with session(unit, Fault("missed_grasp", When(command="GG", nth=2))) as (_, client):
        ends = []
        for target in (840, 103, 840, 103):
            client.send(f"GG:{target}", "RG:")
            assert client.read_until(b"!\r\n") == b"RG!\r\n"
            ends.append(client.ask("APG?"))
        assert ends == ["APG=840", "APG=103", "APG=840", "APG=471"]


def test_a_smaller_queue_overflows_and_says_so_in_the_status(unit: Unit) -> None:
    fault = Fault("queue_overflow", When(command="COORDRELMVT"), queue=3)
    with session(unit, fault, overflow="fail") as (emulator, client):
        client.send(*["COORDRELMVT:100,10,0,0,0,0,0"] * 5, "STAMP:2")
        assert client.read_until(b"=2\r\n") == b"FAIL!\r\nFAIL!\r\nSTAMP=2\r\n"
        assert status(client) & 0x80
        assert client.ask("R:") == "R!"
        assert position(client)[3] == 30
        assert len([v for v in emulator.violations if "beyond the queue's 3" in v.what]) == 2
