"""What a stream is told, what it tells while it runs, and what it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from arm.controller.segments import CountPath
from driver.line.protocol import Position


@dataclass(frozen=True)
class StreamOptions:
    """How a path is streamed.

    Attributes:
        dwell_ms: the unit stands at least this long first, while segments are loaded; longer where a damaged one could
            not be stopped otherwise (`driver.mars.lookahead`).
        ahead_s: most motion that the unit holds, and what it plays out if the link is lost; more on a slow line.
        queue: most segments that the unit holds; it takes 200.
        poll_s: between two looks at position and status, controller seconds.
        following_counts: how far any axis may be outside the stretch of path it should be on.
        tube_counts: the same from where the path has it within the time that its regulator lags, where the unit echoes
            nothing (`driver.execution.path_watch`), beside what the unit allows at rest; what a real arm
            needs is not known.
        preload: the unit stands until the whole motion is loaded and verified; for bad lines, and short motions.
        watch_jaws: look at the jaws too, with every look at the position.
    """

    dwell_ms: int = 300
    ahead_s: float = 1.5
    queue: int = 150
    poll_s: float = 0.2
    following_counts: int = 1500
    tube_counts: int = 100
    preload: bool = False
    watch_jaws: bool = False


@dataclass(frozen=True)
class Progress:
    """One look at a running motion.

    Attributes:
        done: segments finished.
        total: segments of the path.
        planned_s: time of the finished ones, as sent.
        position: the unit's own sample.
        override: factor of velocities that is sent now.
        durations_s: of all segments, as they were sent or will be.
        jaws: how far the jaws were closed at the last look, 0 open to 1 closed; None where they are not watched.
    """

    done: int
    total: int
    planned_s: float
    position: Position
    override: float = 1.0
    jaws: float | None = None
    durations_s: Sequence[float] = ()


@dataclass(frozen=True)
class Sent:
    """What was really sent, and how it ended.

    Attributes:
        path: the segments as sent (without the dwell): those that were asked for, longer under an override.
        start_s: end of the dwell, controller clock.
        duration_s: from there until the unit was ready, controller seconds.
        end_counts: where the arm settled, (6,).
        ahead_s: most motion that the unit held at any time.
        samples: looks at position and status.
    """

    path: CountPath
    start_s: float
    duration_s: float
    end_counts: tuple[int, ...]
    ahead_s: float
    samples: int
