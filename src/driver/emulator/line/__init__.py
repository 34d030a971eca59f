"""The emulated serial line: ports, timing, and a byte echo interleaved with answers."""

from arm.former import former_names

former_names(__name__, "driver.emulator.line.memory", "Tap", "MemoryLine", "MemoryWire")
