"""Streaming a path of integer segments to the controller, and watching it while it moves.

What is sent is what was certified, to the count. The controller keeps the path exactly and only stretches time, so
progress is read from its own segment numbers, never from the clock (fact sheet, sections 2 and 3).
"""

from __future__ import annotations

from collections.abc import Callable

from arm.controller.segments import CountPath
from arm.errors import ImpossibleError, InputError
from driver.execution.control import Control
from driver.execution.extremes import extremes
from driver.execution.preload import preloaded, refuse_preload
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.speed_override import stretched
from driver.execution.stream_run import StreamRun, encoded
from driver.mars.mars import Mars
from driver.mars.stopping import farthest


def stream(
    mars: Mars,
    path: CountPath,
    on_progress: Callable[[Progress], None] | None = None,
    options: StreamOptions | None = None,
    control: Control | None = None,
) -> Sent:
    """Send a path from where the arm is, and wait until it has settled at its end.

    A segment of order 1 goes as a straight one (COORDMVT), any other as COORDSPLINET.

    Args:
        on_progress: called at every look, also while the arm stands in a pause.
        control: its override now stretches the segments in time, the path stays; a pause ends the feeding, so that
            the arm comes to rest on the path at most the look-ahead later, and what is left goes when the pause ends,
            with the override of then.

    Raises:
        InputError: a segment cannot be sent (duration 0, order above 3, line too long); nothing moved.
        ImpossibleError: the path leaves the unit's limits, or starts more than 25 counts from the arm; or it is to be
            preloaded by a unit that does not echo; nothing moved.
        ExecutionStopped: a fault, a silent or lost link, an interrupt, an abort, an axis that does not follow, an arm
            that was displaced in a pause, an end that is not the path's; with the state and how many segments were
            done.
    """
    if not path.segments:
        raise InputError("a path without segments moves nothing")
    control = control or Control()
    encoded(stretched(path, control.least), path.knots())  # whatever the override becomes, it can be sent
    options = options or StreamOptions()
    if options.preload:
        refuse_preload(mars)
    for corner in extremes(path):
        mars.refuse_outside(corner.tolist(), "the path reaches")
    with mars.guarded("stream"):
        control.require()
    with control.attached(mars.link):
        with mars.guarded("stream"):
            here = mars.require_ready()
        if farthest(here, path.start) > mars.unit.rest_tolerance:
            raise ImpossibleError(
                f"the path starts {farthest(here, path.start)} counts from the arm, at most {mars.unit.rest_tolerance}",
                counts=list(here),
                start=list(path.start),
            )
        if mars.reference != path.start:
            mars.anchor(path.start)
        with mars.guarded("stream"):
            if not options.preload:
                return StreamRun(mars, path, on_progress, options, control).run()
            return preloaded(
                mars,
                lambda slower: StreamRun(mars, path, on_progress, options, control, slower),
                path,
                control,
            )
