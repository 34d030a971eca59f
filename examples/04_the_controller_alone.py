"""The driver with an emulated controller: home, move, read, grip. No planner is loaded."""

import sys

from a465 import Mars, load_unit
from driver.emulator import Emulator
from driver.line.stepped_clock import SteppedClock

unit, clock = load_unit("crs93"), SteppedClock()  # on a real port: Mars("/dev/mars", unit)
with Emulator(unit, clock) as emulator, Mars(emulator.open_line(), unit, clock) as mars:
    print(mars.identify())
    mars.initialise(home=True)
    print("at soft home:", mars.counts())
    mars.move_to(unit.counts([0.2, 0.0, -0.785, 0.0, -0.785, 0.0]).tolist())
    print("moved to:    ", mars.counts())
    print("jaws:        ", mars.gripper(fraction_closed=0.5))

print("planner loaded:", "pinocchio" in sys.modules or "coal" in sys.modules)
