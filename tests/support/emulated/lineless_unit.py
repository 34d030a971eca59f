"""The emulated unit without a line."""

from __future__ import annotations

from arm.controller.unit import load_unit
from driver.emulator.commands import Interpreter
from driver.emulator.options import EmulatorOptions
from driver.emulator.unit.machine import Machine

UNIT = load_unit("crs93")


def made(options: EmulatorOptions | None = None) -> Interpreter:
    return Interpreter(Machine(UNIT, None, options or EmulatorOptions()))


def grouped(options: EmulatorOptions | None = None) -> Interpreter:
    unit = made(options)
    unit.take("COORDGRP:A,B,C,D,E,F")
    return unit


def finish(unit: Interpreter, most_ms: int = 120_000) -> list[str]:
    """Run until idle; what was answered on the way."""
    answers = []
    for _ in range(most_ms):
        if not unit.machine.busy:
            break
        unit.machine.run(1)
        answers += unit.ready()
    assert not unit.machine.busy
    return answers
