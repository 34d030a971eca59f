"""An emulated unit with a client, in stepped time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from arm.controller.unit import Unit
from driver.emulator import Emulator, EmulatorOptions
from driver.line.stepped_clock import SteppedClock
from wire.client import SteppedClient


@contextmanager
def connected(unit: Unit, **options: object) -> Iterator[tuple[Emulator, SteppedClient]]:
    made = EmulatorOptions(**options)  # type: ignore[arg-type]
    with (
        Emulator(unit, SteppedClock(), options=made) as emulator,
        SteppedClient(emulator.open_line()) as client,
    ):
        client.send("ECHO:0")
        client.read_until(b"ECHO:0\n")
        yield emulator, client
