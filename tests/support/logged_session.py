"""A wire log made at the wire: the real driver on the emulated unit, with all that a session can hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.errors import ExecutionStopped
from arm.motion import CountPath, Segment
from arm.unit import load_unit
from driver.clock import Clock
from driver.emulator import Emulator, Record
from driver.mars import Mars
from driver.stream import Progress, stream
from driver.wirelog import WireLog

DISTANCE = (30000, -4000, 15000, 9000, -20000, 25000)


class Jaws:
    """Something stands between the jaws."""

    def jaws(self, counts: tuple[int, ...], from_adc: int, to_adc: int) -> int:
        return max(to_adc, 420) if to_adc < from_adc else to_adc


def quintic(start: tuple[int, ...], n: int, distance: tuple[int, ...] = DISTANCE) -> CountPath:
    """From rest to rest in n cubic pieces of 100 ms."""
    x = np.linspace(0.0, 1.0, n + 1)[:, None]
    way = np.array(distance, dtype=float)
    knots = np.rint((x**3 * (10 + x * (-15 + 6 * x))) * way).astype(int)
    slopes = 30 * x**2 * (1 - x) ** 2 * way / n
    segments = []
    for i in range(n):
        d = knots[i + 1] - knots[i]
        a1, a3 = np.rint(slopes[i]).astype(int), np.rint(slopes[i] + slopes[i + 1] - 2 * d).astype(int)
        segments.append(Segment(100, tuple(tuple(int(v) for v in row) for row in (a1, d - a1 - a3, a3))))
    return CountPath(start, tuple(segments))


@dataclass(frozen=True)
class LoggedRun:
    """The log, and what truly happened.

    Attributes:
        home: counts after homing.
        whole: the path that was streamed to its end.
        cut: the path whose stream was stopped.
        record: of the emulated arm at every millisecond.
    """

    log: Path
    home: tuple[int, ...]
    whole: CountPath
    cut: CountPath
    record: Record


def logged_run(log: Path, time_scale: float = 20.0) -> LoggedRun:
    """Home, an absolute move, a stream that ends in a straight segment, jaws on an object, a stream that is stopped."""
    unit, clock = load_unit("crs93"), Clock(time_scale)
    with Emulator(unit, clock, Jaws()) as emulator:
        with WireLog(log, clock) as wire, Mars(emulator.open_pty(), unit, clock, wire) as mars:
            mars.identify()
            mars.initialise()
            home = mars.counts()
            mars.move_to(tuple(c + 2000 for c in home))
            bent = quintic(mars.reference or home, 40)
            whole = CountPath(bent.start, (*bent.segments, Segment(400, ((500, 40, -300, 0, 200, -100),))))
            stream(mars, whole)
            mars.gripper(1.0)
            cut = quintic(whole.end, 40, tuple(-d for d in DISTANCE))
            _stream_in_part(mars, cut)
        record = emulator.record()
    return LoggedRun(log, home, whole, cut, record)


def _stream_in_part(mars: Mars, path: CountPath) -> None:
    def look(progress: Progress) -> None:
        if progress.done >= 12:
            raise KeyboardInterrupt

    try:
        stream(mars, path, look)
    except ExecutionStopped as stopped:
        if stopped.data.get("reason") != "interrupted":
            raise
    else:
        raise AssertionError("the stream was not stopped")
