"""An emulated unit with scripted faults, at the wire."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions, Fault
from driver.line.stepped_clock import SteppedClock
from wire.client import SteppedClient

GROUP = ("ECHO:0", "COORDGRP:A,B,C,D,E,F", "COORDDISCONT:5")


class Block:
    """Something between the jaws."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        return max(to_adc, 471)


@contextmanager
def session(unit: Unit, *faults: Fault, **options: object) -> Iterator[tuple[Emulator, SteppedClient]]:
    """An emulator with these faults, and a client that has switched the echo off and formed the group."""
    made = EmulatorOptions(faults=faults, **options)  # type: ignore[arg-type]
    with (
        Emulator(unit, SteppedClock(), Block(), made) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send(*GROUP, "STAMP:1")
        assert client.read_until(b"STAMP=1\r\n").endswith(b"STAMP=1\r\n")
        yield emulator, client


def events(emulator: Emulator) -> list[tuple[str, bool]]:
    return [(e.kind, e.over) for e in emulator.faults]


def status(client: SteppedClient) -> int:
    return int(client.ask("ST?").removeprefix("ST="))


def position(client: SteppedClient) -> list[int]:
    return [int(v) for v in client.ask("COORDAP?").removeprefix("COORDAP=").split(",")]
