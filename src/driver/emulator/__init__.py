"""The emulated MARS-8 controller with its arm: what `driver.mars` talks to when there is no hardware."""

from driver.emulator.behaviour import EmulatorOptions
from driver.emulator.machine import Plant
from driver.emulator.motion_record import Record, Violation
from driver.emulator.server import Emulator

__all__ = ["Emulator", "EmulatorOptions", "Plant", "Record", "Violation"]
