"""A wire log made at the wire: the real driver on the emulated unit, with all that a session can hold."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import load_unit
from arm.errors import ExecutionStopped
from arms.count_paths import DISTANCE, Jaws, quintic
from driver.emulator import Emulator, Record
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream


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


def logged_run(log: Path) -> LoggedRun:
    """Home, an absolute move, a stream that ends in a straight segment, jaws on an object, a stream that is stopped."""
    unit, clock = load_unit("crs93"), SteppedClock()
    with Emulator(unit, clock, Jaws()) as emulator:
        with WireLog(log, clock) as wire, Mars(emulator.open_line(), unit, clock, wire) as mars:
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
