"""A session as motion of joints: where the arm was seen, and what it was sent, in rad on the log's clock."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from arm.controller.segments import CountPath
from arm.controller.unit import UNITS, Unit, load_unit
from arm.errors import InputError
from arm.se3 import Array, frozen
from driver.log.motions import LoggedMotion
from driver.log.read import Session

AXES = 6


@dataclass(frozen=True)
class Executed:
    """Where the arm was seen, sample by sample; times strictly increase.

    Attributes:
        time_s: (m,) by the unit's own clock, s since the log was opened.
        q: (m, 6) rad.
        velocity: (m, 6) rad/s, by differences of neighbouring samples.
        motion: (m,) number of the session's motion that ran, -1 between motions.
        segment: (m,) number of its segment, -1 where none or unknown.
        jaws: (m,) how far the jaws were closed when last asked, 0 open to 1 closed; NaN before that.
        unhomed: samples left out, because the arm was homed after them and counts then began anew.
    """

    time_s: Array
    q: Array
    velocity: Array
    motion: tuple[int, ...]
    segment: tuple[int, ...]
    jaws: Array
    unhomed: int


@dataclass(frozen=True)
class Planned:
    """One motion as it was sent.

    Attributes:
        number: of the session's motion.
        sent_s: when its first line was sent, s since the log was opened.
        time_s: (m,) when it is at each point, if the unit neither stretches nor stops it.
        q: (m, 6) rad at the ends of segments.
        velocity: (m, 6) rad/s there; None if some segment is straight, for then it jumps. With it, cubics through the
            points are the very segments.
    """

    number: int
    sent_s: float
    time_s: Array
    q: Array
    velocity: Array | None


def unit_of(session: Session, name: str | None) -> Unit:
    """The unit of a session: the one named, or the one noted in the log, or told by its gripper's axis letter.

    Raises:
        InputError: nothing tells, or the name is unknown.
    """
    runs = [n.data for n in session.noted("run") if n.data.get("unit") in UNITS]
    if runs and name in (None, runs[-1]["unit"]):
        return load_unit(runs[-1]["unit"]).calibrated(runs[-1].get("joint_offsets_rad", np.zeros(AXES)))
    if name is not None:
        return load_unit(name)
    sent = {line.text.partition(":")[0] for line in session.sent}
    fitting = [u for u in map(load_unit, UNITS) if f"ANAXSETUP{u.gripper.axis}" in sent]
    if len(fitting) == 1:
        return fitting[0]
    raise InputError(
        f"{session.file}: does not tell which unit it is of; give --unit, one of {', '.join(UNITS)}",
        file=str(session.file),
        choices=list(UNITS),
    )


def executed(session: Session, unit: Unit) -> Executed:
    """Where the arm was seen since it was last homed.

    Raises:
        InputError: the log holds no position sample.
    """
    homed_s = session.homed_s
    homed = [s for s in session.samples if s.heard_s > homed_s and len(s.position.counts) == AXES]
    samples, last_s = [], -np.inf
    for sample in homed:
        if sample.time_s > last_s:
            samples.append(sample)
            last_s = sample.time_s
    if not samples:
        raise InputError(
            f"{session.file}: holds no position sample of a homed arm, so nothing was executed",
            file=str(session.file),
        )
    at = {id(s): (i, m.segment_of(s)) for i, m in enumerate(session.motions) for s in m.samples}
    places = [at.get(id(s), (-1, None)) for s in samples]
    times = np.array([s.time_s for s in samples])
    q = unit.positions([s.position.counts for s in samples])
    velocity = np.gradient(q, times, axis=0) if len(times) > 1 else np.zeros_like(q)
    set_up = (line.time_s for line in session.sent if line.text.startswith("ANAXSETUP"))
    set_up_s = max(set_up, default=-math.inf)  # before that the axis does not count what the jaws tell
    known = [j for j in session.jaws if j.time_s > set_up_s]
    asked = [j.time_s for j in known]
    before = [bisect_right(asked, s.heard_s) - 1 for s in samples]
    jaws = [unit.gripper.fraction_closed(known[k].adc) if k >= 0 else np.nan for k in before]
    return Executed(
        frozen(times),
        frozen(q),
        frozen(velocity),
        tuple(motion for motion, _ in places),
        tuple(-1 if segment is None else segment for _, segment in places),
        frozen(jaws),
        len(session.samples) - len(homed),
    )


def planned(session: Session, unit: Unit) -> tuple[Planned, ...]:
    """Every motion that was sent and whose start is known, in order, none beyond the start of the next."""
    found = []
    for number, motion in enumerate(session.motions):
        made = _absolute(number, motion, unit) if motion.target is not None else _stream(number, motion, unit)
        if made is not None:
            found.append(made)
    followings = [*(m.time_s[0] for m in found[1:]), np.inf][: len(found)]
    cut = (_before(m, end_s) for m, end_s in zip(found, followings, strict=True))
    return tuple(m for m in cut if len(m.time_s))


def _absolute(number: int, motion: LoggedMotion, unit: Unit) -> Planned | None:
    """From rest to rest; the unit alone decides how long it takes, so its end is when it was ready."""
    start, target, ready_s = motion.start, motion.target, motion.ready_s
    if start is None or target is None or ready_s is None or ready_s <= motion.sent_s:
        return None
    q = unit.positions([start, target])
    return Planned(
        number, motion.sent_s, frozen([motion.sent_s, ready_s]), frozen(q), frozen(np.zeros_like(q))
    )


def _stream(number: int, motion: LoggedMotion, unit: Unit) -> Planned | None:
    path = motion.path
    if path is None:
        return None
    durations = np.array([s.duration_ms for s in path.segments]) / 1e3
    times = motion.begin_s + np.concatenate([[0.0], np.cumsum(durations)])
    straight = any(len(s.coefficients) == 1 for s in path.segments) or bool(np.any(durations <= 0.0))
    velocity = None if straight else frozen(_knot_velocity(path) / unit.counts_per_rad)
    return Planned(number, motion.sent_s, frozen(times), frozen(unit.positions(path.knots())), velocity)


def _knot_velocity(path: CountPath) -> Array:
    """Counts/s where segments meet, of the later one; they differ by the rounding alone."""
    return np.stack([*(s.derivative(0.0) for s in path.segments), path.segments[-1].derivative(1.0)])


def _before(motion: Planned, end_s: float) -> Planned:
    """What of a motion is before the next one; a motion that was stopped is cut there."""
    keep = motion.time_s < end_s
    velocity = None if motion.velocity is None else frozen(motion.velocity[keep])
    return Planned(
        motion.number, motion.sent_s, frozen(motion.time_s[keep]), frozen(motion.q[keep]), velocity
    )
