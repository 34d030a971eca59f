"""Faults of the emulated unit and its line, and when they happen."""

from arm.former import former_names

former_names(__name__, "driver.emulator.faults.model", "Kind", "Direction", "When", "Fault", "FaultEvent")
