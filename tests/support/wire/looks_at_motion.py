"""What the driver tells of a move while it runs, without a driver."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from arm.plan_file import Move
from driver.execution.progress import Progress
from driver.line.protocol import Position


def looks(
    move: Move, every_s: float = 0.1, stretch: float = 1.0, off: int = 0
) -> Iterator[tuple[float, Progress]]:
    """Samples of a move, `off` counts beside it, with the time of each on the planned path."""
    durations = [stretch * s.duration_ms / 1e3 for s in move.path.segments]
    ends = np.cumsum([s.duration_ms / 1e3 for s in move.path.segments])
    for t in np.arange(0.0, move.path.duration_s, every_s):
        done = int(np.searchsorted(ends, t, side="right"))
        counts = tuple(int(c) + off for c in np.rint(move.path.at([t])[0]))
        position = Position(int(1e3 * t) % 65536, done, 1, counts)
        yield (
            float(t),
            Progress(done, len(durations), sum(durations[:done]), position, 1.0 / stretch, None, durations),
        )
