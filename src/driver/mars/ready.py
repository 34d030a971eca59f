"""Waiting until the controller generates no motion, and until the arm is at rest."""

from __future__ import annotations

from collections.abc import Callable

from arm.errors import ExecutionStopped
from driver.line.link import Link, NoAnswer
from driver.line.protocol import Failed, Ready, Status, encode
from driver.mars.stopping import read_status, refuse_restarted

POLL_S = 0.25  # between two status polls
IDLE_POLLS = 4  # R is sent again if this many polls in a row find the unit idle and R! has not come


def wait_ready(
    link: Link, what: str, timeout: float, axis: str = "", on_poll: Callable[[], None] | None = None
) -> None:
    """Wait for ``R!`` (or ``Rx!``) and a status that is not busy.

    ``R!`` alone proves nothing: it may answer an earlier wait that was given up. It means that the path generator has
    finished, not that the arm is at rest (docs/sources.md, "Lines and commands"). So let the arm settle afterwards.

    Args:
        what: name of the action waited for, for the message.
        timeout: controller seconds.
        axis: the axis to wait for, or "" for all.
        on_poll: called at each status poll, four times a second.

    Raises:
        ExecutionStopped: FAIL!, a fault in the status, not finished in time, or the link is lost.
    """
    link.synchronise(attempts=2)  # noise may damage one stamp
    link.events.clear()
    link.send(encode("R", axis=axis))
    deadline = link.deadline(timeout)
    ready, idle = False, 0
    while True:
        until = min(deadline, link.clock.now() + POLL_S)
        while link.clock.now() < until and (ready or not link.events):
            link.receive(until)
        status = read_status(link)
        refuse_failure(link, status, what)
        if on_poll is not None:
            on_poll()
        ready = ready or any(isinstance(e, Ready) and e.axis == axis for e in link.events)
        link.events.clear()
        if ready and not status.busy:
            return
        idle = 0 if status.busy else idle + 1
        if idle == IDLE_POLLS:  # R or its answer was lost on the line: asking again does no harm
            idle = 0
            link.send(encode("R", axis=axis))
        if link.clock.now() >= deadline:
            raise NoAnswer(f"{what}: not finished within {timeout:.1f} s", timeout=timeout, reason="deadline")


def refuse_failure(link: Link, status: Status, what: str) -> None:
    """Refuse to continue after a fault in the status, ``FAIL!``, or a power cycle of the unit.

    Raises:
        ExecutionStopped: with the reason ``fault`` or ``restarted``.
    """
    refuse_restarted(link, what)
    if status.fault:
        why = f"{what}: {' and '.join(status.faults())}; to continue: {status.remedy()}"
        raise ExecutionStopped(why, status=status.word, reason="fault")
    if any(isinstance(e, Failed) for e in link.events):
        raise ExecutionStopped(f"{what}: the unit answered FAIL!", status=status.word, reason="fault")
