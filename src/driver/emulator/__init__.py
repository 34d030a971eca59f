"""The emulated MARS-8 controller with its arm, which `driver.mars.mars` can drive instead of hardware."""

from driver.emulator.emulator import Emulator
from driver.emulator.faults.model import Fault, FaultEvent, When
from driver.emulator.options import EmulatorOptions
from driver.emulator.unit.plant import Plant
from driver.emulator.unit.record import Record, Violation

__all__ = ["Emulator", "EmulatorOptions", "Fault", "FaultEvent", "Plant", "Record", "Violation", "When"]
