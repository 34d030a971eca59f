"""Options, progress and result of a stream."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from arm.controller.segments import CountPath


@dataclass(frozen=True)
class StreamOptions:
    """How a path is sent and monitored. A controller ignores what it has no use for (`Controller.follow`).

    Attributes:
        dwell_ms: shortest initial dwell, in which segments are loaded; longer if needed to stop before a damaged
            segment (`driver.mars.lookahead`).
        ahead_s: most motion that the unit holds; more on a slow line. The unit still executes it if the link is lost.
        queue: most segments that the unit holds; its capacity is 200.
        poll_s: between two polls of position and status, controller seconds.
        following_counts: how far any axis may be outside the part of the path that is being executed.
        tube_counts: how far any axis may be from the path, its servo's lag allowed for, if the unit does not echo
            (`driver.mars.streaming.path_watch`). The unit's rest tolerance is added. What a real arm needs is not
            known.
        preload: load and verify the whole motion before the arm moves; for bad lines and short motions.
        watch_jaws: poll the jaws too, with every position.
        held_back_counts: how far beyond the rest tolerance any axis may rest from the end of the path, because what the
            jaws hold touches something there.
        start_held_counts: how far beyond the rest tolerance any axis may be from the start of the first path, because
            the jaws have closed on something that does not give way.
    """

    dwell_ms: int = 300
    ahead_s: float = 1.5
    queue: int = 150
    poll_s: float = 0.2
    following_counts: int = 1500
    tube_counts: int = 100
    preload: bool = False
    watch_jaws: bool = False
    held_back_counts: int = 0
    start_held_counts: int = 0


class Position(Protocol):
    """A sample of where the arm is."""

    @property
    def time_ms(self) -> int:
        """The unit's clock; may wrap."""
        ...

    @property
    def counts(self) -> tuple[int, ...]:
        """Positions in the order of `Unit.axes`."""
        ...


@dataclass(frozen=True)
class Progress:
    """One sample of a running motion.

    Attributes:
        done: segments finished.
        total: segments of the path.
        planned_s: total duration of the finished segments, as sent.
        position: sample read from the unit.
        override: present speed override.
        durations_s: of all segments, as sent or to be sent.
        jaws: how far the jaws were closed at the last poll, 0 open to 1 closed; None if they are not polled.
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
    """The motion as sent, and its end.

    Attributes:
        path: the segments as sent (without the dwell): those requested, with longer durations under an override.
        start_s: end of the dwell, controller clock.
        duration_s: from `start_s` until the unit was ready, controller seconds.
        end_counts: where the arm settled, (6,).
        ahead_s: most motion that the unit held at any time, s.
        samples: number of position samples.
    """

    path: CountPath
    start_s: float
    duration_s: float
    end_counts: tuple[int, ...]
    ahead_s: float
    samples: int
