"""Scripted faults of the emulated unit, at the wire: each does what it says, when it says, and is noted."""

from __future__ import annotations

from arm.controller.unit import Unit
from driver.emulator import Fault
from driver.emulator.faults.model import KINDS
from emulated.faulty_unit import events, session


def test_every_kind_can_be_injected_while_the_arm_moves(unit: Unit) -> None:
    fields = {
        "axis_error": {"axis": "B"}, "stuck_axis": {"axis": "B"}, "drift": {"axis": "B", "counts_per_s": 5.0},
        "lag": {"lag_ms": 20.0}, "delayed_bytes": {"delay_ms": 5.0}, "stray_line": {"text": "x"},
    }  # fmt: skip
    for kind in KINDS:
        with session(unit) as (emulator, client):
            client.send("COORDMV:90000,0,0,0,0,0", "R:", "STAMP:2")
            client.read_until(b"=2\r\n")
            emulator.inject(Fault(kind, **fields.get(kind, {})))  # type: ignore[arg-type]
            assert events(emulator) == [(kind, False)]
            client.line.clock.sleep(0.5)
            assert emulator.failure is None
