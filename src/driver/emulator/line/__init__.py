"""The emulated serial line: ports, timing, and a byte echo interleaved with answers."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(__name__, "driver.emulator.line.memory", "Tap", "MemoryLine", "MemoryWire")
