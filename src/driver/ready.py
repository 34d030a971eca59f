"""Waiting until the controller generates no motion any more."""

from __future__ import annotations

from arm.errors import ExecutionStopped
from driver.link import Link, NoAnswer
from driver.protocol import Failed, Ready, Status, encode
from driver.rest import read_status

POLL_S = 0.25


def wait_ready(link: Link, what: str, timeout: float, axis: str = "") -> None:
    """Wait for ``R!`` (or ``Rx!``) and for the status to agree.

    ``R!`` alone is not trusted: one that an earlier, abandoned wait asked for may still be on its way. Nor does it
    mean that the arm stands: its path generator has finished (fact sheet, section 1), so settle afterwards.

    Args:
        what: is waited for, for the message.
        timeout: controller seconds.
        axis: to wait for, or "" for all.

    Raises:
        ExecutionStopped: FAIL!, a fault in the status, no end in time, or the link is lost.
    """
    link.synchronise()
    link.events.clear()
    link.send(encode("R", axis=axis))
    deadline = link.deadline(timeout)
    ready = False
    while True:
        until = min(deadline, link.clock.now() + POLL_S)
        while link.clock.now() < until and (ready or not link.events):
            link.receive(until)
        status = read_status(link)
        refuse_failure(link, status, what)
        ready = ready or any(isinstance(e, Ready) and e.axis == axis for e in link.events)
        link.events.clear()
        if ready and not status.busy:
            return
        if link.clock.now() >= deadline:
            raise NoAnswer(f"{what}: not finished within {timeout:.1f} s", timeout=timeout, reason="deadline")


def refuse_failure(link: Link, status: Status, what: str) -> None:
    """Refuse to go on when the status has a fault or ``FAIL!`` has come.

    Raises:
        ExecutionStopped: with the reason ``fault``.
    """
    if status.fault or any(isinstance(e, Failed) for e in link.events):
        why = " and ".join(status.faults()) or "the unit answered FAIL!"
        raise ExecutionStopped(f"{what}: {why}", status=status.word, reason="fault")
