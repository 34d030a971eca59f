"""Emulated units that are recorded in stepped time, and recordings in which something is changed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from arm.controller.unit import load_unit
from arm.errors import A465Error
from driver.emulator import Emulator, EmulatorOptions
from driver.emulator.line.memory import MemoryLine, Tap
from driver.line.stepped_clock import SteppedClock
from driver.record.take import Recorder
from driver.record.tape import RECEIVED, SENT, STEP, Event
from driver.record.unit_record import UnitRecord

FIRMWARE = "MARS8"


@dataclass(frozen=True)
class Recorded:
    """What came of recording a unit.

    Attributes:
        record: all that was kept.
        error: that ended it, or None.
        lines: that the unit received.
        took_s: of the unit's time.
        unharmed: nothing has moved, no register was set, and no violation was seen.
    """

    record: UnitRecord
    error: A465Error | None
    lines: tuple[str, ...]
    took_s: float
    unharmed: bool


def recorded_unit(
    options: EmulatorOptions | None = None,
    seconds: float = 2.0,
    to_unit: Tap | None = None,
    to_host: Tap | None = None,
    prepare: Callable[[Emulator, MemoryLine, SteppedClock], None] = lambda emulator, line, clock: None,
) -> Recorded:
    """Record an emulated unit, with damage to its line."""
    clock = SteppedClock()
    with Emulator(load_unit("crs93"), clock, options=options) as emulator:
        line = emulator.open_line(to_unit=to_unit, to_host=to_host)
        prepare(emulator, line, clock)
        before = _state(emulator)
        recorder, error = Recorder(line, FIRMWARE, seconds, clock), None
        try:
            recorder.run()
        except A465Error as caught:
            error = caught
        lines = tuple(text for _, text in emulator.lines)
        unharmed = _state(emulator) == before and not emulator.machine.busy
        return Recorded(recorder.record(), error, lines, clock.now(), unharmed)


def _state(emulator: Emulator) -> object:
    machine = emulator.machine
    return (
        emulator.counts(),
        dict(machine.registers),
        machine.group,
        machine.jaws_adc(),
        emulator.violations,
    )


def changed(
    record: UnitRecord, step: str, line: str, change: Callable[[str], str], most: int = 1000
) -> UnitRecord:
    """Change what came for a line sent in a step, in the first `most` places; an empty text is left out."""
    now, sent, left = "", "", most
    events: list[Event] = []
    for event in record.events:
        now = event.data if event.kind == STEP else now
        sent = event.data.rstrip("\n") if event.kind == SENT else sent
        if event.kind == RECEIVED and now == step and sent.startswith(line):
            data = change(event.data) if left else event.data
            left -= data != event.data
            event = replace(event, data=data)
            if not data:
                continue
        events.append(event)
    return replace(record, events=tuple(events))


def answering(record: UnitRecord, line: str, answer: str) -> UnitRecord:
    """Let something come for a question that was not answered."""
    events: list[Event] = []
    for event in record.events:
        events.append(event)
        if event.kind == SENT and event.data == f"{line}\n":
            events.append(Event(event.time_s + 0.01, RECEIVED, answer))
    return replace(record, events=tuple(events))
