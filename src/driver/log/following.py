"""Following error at rest: where the axes were, and where they had been sent, when a motion of a log had ended."""

from __future__ import annotations

from dataclasses import dataclass

from driver.log.motions import LoggedMotion
from driver.log.read import Session


@dataclass(frozen=True)
class Rest:
    """The arm at rest after a motion.

    Attributes:
        time_s: of the last sample before the next motion, s on the log's clock.
        off: counts read minus counts sent, (6,).
    """

    time_s: float
    off: tuple[int, ...]


def rests_of(session: Session) -> tuple[Rest, ...]:
    """Return the rests after all motions that ended where they were sent, in order.

    Left out are motions that were stopped or that the unit did not confirm, whose end does not follow from what was
    sent (a start that was only sampled has a following error itself), that precede a homing, or after which no position
    was read.
    """
    found = []
    followings = [*(motion.sent_s for motion in session.motions[1:]), float("inf")]
    for motion, until_s in zip(session.motions, followings, strict=False):
        end = _sent_to(motion)
        if end is None or motion.ready_s is None or motion.sent_s < session.homed_s:
            continue
        read = [sample for sample in session.samples if motion.ready_s < sample.heard_s <= until_s]
        if read:
            off = tuple(is_at - sent for is_at, sent in zip(read[-1].position.counts, end, strict=True))
            found.append(Rest(read[-1].time_s, off))
    return tuple(found)


def _sent_to(motion: LoggedMotion) -> tuple[int, ...] | None:
    if motion.target is not None:
        return motion.target
    return motion.path.end if motion.path is not None and motion.start_exact else None
