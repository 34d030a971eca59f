"""A wire log of an arm whose axes come to rest beside where they were sent, by chosen counts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arm.controller.unit import Unit, load_unit
from arms.count_paths import DISTANCE, Jaws, quintic
from driver.emulator import Emulator
from driver.emulator.faults.model import Fault, When
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream

ABSOLUTE_MOVES = 3  # of every log, two of them by homing; no axis is off after them
WITH_MOTION = When(command="COORDSPLINET")
SPEED = 400.0  # counts/s with which an axis gets off


def erring_log(log: Path, off: Sequence[Sequence[int]], lag_ms: float = 0.0) -> Unit:
    """Stream one motion per row of `off`, to and fro; after each the axes are off by that row's counts, (6,).

    Args:
        log: file to write.
        off: counts, smaller than the unit's tolerance at rest.
        lag_ms: lag of all axes in motion.
    """
    unit, clock = load_unit("crs93"), SteppedClock()
    with (
        Emulator(unit, clock, Jaws()) as emulator,
        WireLog(log, clock) as wire,
        Mars(emulator.open_line(), unit, clock, wire) as mars,
    ):
        mars.identify()
        mars.initialise()
        mars.move_to(tuple(c + 2000 for c in mars.counts()))
        if lag_ms:
            emulator.inject(Fault("lag", lag_ms=lag_ms))
        before: Sequence[int] = (0,) * len(unit.axes)
        for number, row in enumerate(off):
            for axis, was, now in zip(unit.axes, before, row, strict=True):
                if now != was:
                    speed = SPEED if now > was else -SPEED
                    drift = Fault(
                        "drift", WITH_MOTION, axis=axis, counts_per_s=speed, most_counts=abs(now - was)
                    )
                    emulator.inject(drift)
            start = mars.reference
            distance = tuple(d if number % 2 == 0 else -d for d in DISTANCE)
            stream(mars, quintic(start or (), 20, distance))
            mars.settled_counts()
            before = row
    return unit
