"""Stream a path of integer segments to the controller, and monitor the motion.

Exactly the certified counts are sent. The controller keeps the path and only stretches time, so progress is read from
its segment numbers, never from the clock (docs/sources.md, "Coordinated motion" and "Capacity of the line").
"""

from __future__ import annotations

from collections.abc import Callable

from arm.controller.segments import CountPath
from arm.errors import InputError
from driver.execution.control import Control
from driver.execution.progress import Progress, Sent, StreamOptions
from driver.execution.rest import refuse_elsewhere, refuse_path_outside
from driver.execution.speed_override import stretched
from driver.mars.session import Session
from driver.mars.streaming.preload import preloaded, refuse_preload
from driver.mars.streaming.stream_run import StreamRun, encoded


def stream(
    mars: Session,
    path: CountPath,
    on_progress: Callable[[Progress], None] | None = None,
    options: StreamOptions | None = None,
    control: Control | None = None,
) -> Sent:
    """Send a path that starts where the arm is, and wait until the arm has settled at its end.

    A segment of order 1 is sent as a straight one (COORDMVT), any other as COORDSPLINET.

    Args:
        on_progress: called at every poll, also during a pause.
        control: its override stretches the segments in time; the path stays the same. In a pause no more segments are
            sent, so the arm comes to rest on the path within the look-ahead time. The remaining segments are sent when
            the pause ends, with the override set by then.

    Raises:
        InputError: a segment cannot be sent (duration 0, order above 3, line too long); nothing moved.
        ImpossibleError: the path leaves the unit's limits; it starts further from the arm than `Unit.rest_tolerance`
            with `StreamOptions.start_held_counts` allows; or preloading is requested on a unit that does not echo;
            nothing moved.
        ExecutionStopped: a fault, a silent or lost link, an interrupt, an abort, an axis that does not follow, an arm
            displaced during a pause, or an end away from the path's; with the state and the number of segments done.
    """
    if not path.segments:
        raise InputError("path has no segments, must have at least 1")
    control = control or Control()
    encoded(stretched(path, control.least), path.knots())  # raises InputError here, before anything moves
    options = options or StreamOptions()
    if options.preload:
        refuse_preload(mars)
    refuse_path_outside(mars.unit, path)
    with mars.guarded("stream"):
        control.require()
    with control.attached(mars):
        with mars.guarded("stream"):
            here = mars.require_ready(options.start_held_counts)
        # what holds the arm off its target matters only if the path goes on from that target
        held = options.start_held_counts if mars.reference == path.start else 0
        refuse_elsewhere(mars.unit, here, path.start, held)
        if mars.reference != path.start:
            mars.anchor(path.start)
        with mars.guarded("stream"):

            def begin(slower: float = 1.0) -> StreamRun:
                return StreamRun(mars, path, on_progress, options, control, slower)

            return preloaded(mars, begin, path, control) if options.preload else begin().run()
