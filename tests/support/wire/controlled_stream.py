"""Streams that are paused, aborted and slowed down at the wire of a scripted unit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from driver.execution.progress import Progress
from driver.line.clock import Clock
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME


def opened(fake: Any, unit: Unit, clock: Clock) -> Any:
    fake.counts = list(SOFT_HOME)
    with Mars(fake.line, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        mars.move_to(SOFT_HOME)
        fake.lines.clear()
        fake.times.clear()
        yield mars


def run(segments: int, duration_ms: int = 100) -> CountPath:
    """At constant speed, as cubics."""
    zero = (0,) * 6
    return CountPath(SOFT_HOME, (Segment(duration_ms, ((100, 20, -30, 5, 0, 0), zero, zero)),) * segments)


def moved(fake: Any) -> list[str]:
    """The segments received, without the dwell."""
    return [x for x in fake.lines if x.startswith("COORD") and "COORDSPLINET" in x][1:]


class Script:
    """Does one thing after another as the motion goes on: each when its condition holds."""

    def __init__(self, *acts: tuple[Callable[[Progress], bool], Callable[[], None]]) -> None:
        self.acts = list(acts)

    def __call__(self, progress: Progress) -> None:
        if self.acts and self.acts[0][0](progress):
            self.acts.pop(0)[1]()


def reaches(done: int) -> Callable[[Progress], bool]:
    return lambda progress: progress.done >= done


def moved_after_stop(fake: Any) -> list[str]:
    return [line for line in fake.since("STOP:") if line.startswith("COORD") and ":" in line]


def splines(lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith(("COORDSPLINET", "COORDMVT"))]
