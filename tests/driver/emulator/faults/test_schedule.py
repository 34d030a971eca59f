"""When scripted faults come."""

from __future__ import annotations

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions, Fault, When
from driver.emulator.faults.schedule import Schedule
from driver.line.stepped_clock import SteppedClock
from emulated.faulty_unit import position, session
from wire.client import SteppedClient


def test_time_counts_from_the_first_byte_and_not_from_power_up(unit: Unit) -> None:
    fault = Fault("axis_error", When(after_ms=1000), axis="A")
    with Emulator(unit, SteppedClock(), options=EmulatorOptions(faults=(fault,))) as emulator:
        emulator.clock.sleep(3.0)
        with SteppedClient(emulator.open_line()) as client:
            assert emulator.faults == ()
            client.send("ECHO:0")
            client.wait_for(lambda: emulator.faults)
            assert emulator.faults[0].time_ms == 3000 + 1000


def test_the_third_segment_is_the_first_to_meet_a_fault_at_the_third_segment(unit: Unit) -> None:
    faults = Fault("queue_overflow", When(command="COORDRELMVT", nth=3), count=1)
    with session(unit, faults) as (_, client):
        client.send(*[f"COORDRELMVT:50,{10**k},0,0,0,0,0" for k in range(4)], "R:")
        assert client.read_until(b"!\r\n") == b"R!\r\n"
        assert position(client)[3] == 1011


def test_a_fault_at_an_executed_segment_comes_when_it_begins(unit: Unit) -> None:
    with session(unit, Fault("motion_stop", When(segment=3))) as (_, client):
        client.send("COORDSPLINET:300,1,0,0,0,0,0,0", *["COORDRELMVT:100,500,0,0,0,0,0"] * 4, "R:")
        assert client.read_until(b"!\r\n") == b"FAIL!\r\n"
        assert 500 <= position(client)[3] <= 510


def due(schedule: Schedule, until: float = 1e9) -> list[tuple[float, str, bool]]:
    found = []
    while schedule.next_at() <= until:
        at = schedule.next_at()
        fault, over = schedule.take()
        found.append((at, fault.kind, over))
    return found


def test_a_schedule_counts_lines_by_name_with_or_without_axis() -> None:
    faults = [
        Fault("power_off", When(command="HH", nth=3)),
        Fault("motion_stop", When(5, command="HHB")),
        Fault("early_ready", When(command="R", nth=2)),
        Fault("missed_grasp", When(command="COORDMV")),
    ]
    schedule = Schedule(faults)
    lines = [
        "HHA:",
        "RELEASEG:",
        "HHB:",
        "REGMSA:3",
        "R:",
        "COORDMVT:1",
        "RG:",
        "HHC:",
        "COORDMV:1\r",
        "HHB:",
    ]
    for ms, line in enumerate(lines):
        schedule.line(line, float(ms))
    assert due(schedule) == [
        (6.0, "early_ready", False), (7.0, "motion_stop", False), (7.0, "power_off", False),
        (8.0, "missed_grasp", False),
    ]  # fmt: skip


def test_a_schedule_starts_with_the_first_byte_and_keeps_the_order_of_equals() -> None:
    schedule = Schedule(
        [Fault("noise", When(10)), Fault("power_off", When(10)), Fault("motion_stop", When(3))]
    )
    assert due(schedule) == []
    schedule.first_byte(100.0)
    schedule.first_byte(200.0)
    schedule.inject(Fault("lag", When(1), lag_ms=5), 50.0)
    assert [kind for _, kind, _ in due(schedule)] == ["lag", "motion_stop", "noise", "power_off"]
