"""Load and verify a whole motion before it begins, for serial lines with many transmission errors.

The unit waits in a dwell that is long enough to receive and echo all segments. If an echo differs, STOP clears the
unit's queue while the arm is still at rest, and the whole motion is sent again.
"""

from __future__ import annotations

from collections.abc import Callable

from arm.controller.segments import CountPath
from arm.errors import A465Error, ImpossibleError
from driver.execution.control import Control
from driver.execution.progress import Sent
from driver.execution.rest import farthest
from driver.line.link import LineDamaged
from driver.mars.session import Session
from driver.mars.streaming.stream_run import StreamRun

PRELOADS = 3  # attempts to send a motion
SLOWER = 1.5  # each attempt allows this many times the time of the one before


def refuse_preload(mars: Session) -> None:
    """Refuse to preload on a unit that does not echo, as nothing can be verified there.

    Raises:
        ImpossibleError: the unit does not echo.
    """
    if not mars.link.echoes:
        raise ImpossibleError(
            "preload: the unit does not echo, so nothing can be verified before the arm moves; omit the option",
            option="preload",
        )


def preloaded(mars: Session, begin: Callable[[float], StreamRun], path: CountPath, control: Control) -> Sent:
    """Load a motion while the arm is at rest, in up to `PRELOADS` attempts, then let it run.

    Args:
        begin: creates the stream, given the factor by which the line is assumed slower than nominal.

    Raises:
        ExecutionStopped: as the stream; LineDamaged of the last attempt, with ``attempts``.
    """
    for attempt in range(1, PRELOADS + 1):
        stream = begin(SLOWER ** (attempt - 1))
        loaded, total = stream.at_once
        if attempt == 1 and loaded < total:
            control.tell(
                f"the motion has {total} segments: {loaded} fit into the unit and are verified before the arm moves, "
                "each of the others before it begins"
            )
        try:
            return stream.run()
        except LineDamaged as error:
            error.data["attempts"] = attempt
            if not stream.stands or attempt == PRELOADS:
                raise
            rest = mars.stop()
            away = None if rest.counts is None else farthest(rest.counts, path.start)
            if not rest.at_rest or away is None or away > mars.unit.rest_tolerance:
                raise
            mars.note("sent_again", attempt=attempt, why=str(error))
            control.tell(f"{error}; the arm has not moved, so the motion is sent again")
        mars.anchor(path.start)
    raise A465Error("the last attempt returns or raises")
