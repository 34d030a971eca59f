"""Faults of the emulated unit and its line, and when they happen."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__, "driver.emulator.faults.model", "Kind", "Direction", "When", "Fault", "FaultEvent"
    )
