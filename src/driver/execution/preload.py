"""Motions that are loaded and verified before any of them begins: for lines that damage much.

The unit stands in a dwell that is long enough for all segments to come back. What does not come back as it was sent is
flushed by STOP, at rest, and the whole motion is sent again.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from arm.controller.segments import CountPath
from arm.errors import A465Error, ImpossibleError
from driver.execution.control import Control
from driver.execution.progress import Sent
from driver.line.link import LineDamaged
from driver.mars.mars import Mars
from driver.mars.stopping import farthest

PRELOADS = 3  # times that a motion is sent,
SLOWER = 1.5  # and each time with so much more time for it


class Loading(Protocol):
    """A stream that begins with a dwell."""

    @property
    def stands(self) -> bool:
        """Nothing that was sent can have begun."""
        ...

    @property
    def at_once(self) -> tuple[int, int]:
        """How many segments are loaded before any begins, and how many there are."""
        ...

    def run(self) -> Sent:
        """Send it, and wait for its end."""
        ...


def refuse_preload(mars: Mars) -> None:
    """Refuse to load motions before they begin where nothing tells whether they arrived.

    Raises:
        ImpossibleError: the unit does not echo.
    """
    if not mars.link.echoes:
        raise ImpossibleError(
            "preload: the unit sends nothing back, so nothing can be verified before it moves; leave the option out",
            option="preload",
        )


def preloaded(mars: Mars, begin: Callable[[float], Loading], path: CountPath, control: Control) -> Sent:
    """Load a motion while the arm stands, again if it was damaged, `PRELOADS` times in all; then let it run.

    Args:
        begin: makes the stream; is told how many times slower than it should be the line is taken to be.

    Raises:
        ExecutionStopped: as the stream; LineDamaged of the last attempt, with ``attempts``.
    """
    for attempt in range(1, PRELOADS + 1):
        stream = begin(SLOWER ** (attempt - 1))
        loaded, total = stream.at_once
        if attempt == 1 and loaded < total:
            control.tell(
                f"the motion has {total} segments: {loaded}, which the unit holds, are verified before it moves, "
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
            control.tell(f"{error}; nothing has moved: the motion is sent again")
        mars.anchor(path.start)
    raise A465Error("the last attempt returns or raises")
