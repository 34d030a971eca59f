"""The joint motion of a session in rad on the log's clock: the sampled positions, and the motions sent."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace

import numpy as np

from arm.controller.unit import UNITS, Unit, load_unit, noted_unit, unit_called
from arm.errors import InputError
from arm.se3 import Array, frozen
from driver.log.motions import LoggedMotion
from driver.log.read import Session

AXES = 6


@dataclass(frozen=True)
class Executed:
    """Position samples; times strictly increase.

    Attributes:
        time_s: (m,) on the unit's clock, s since the log was opened.
        q: (m, 6) rad.
        velocity: (m, 6) rad/s, by differences of neighbouring samples.
        motion: (m,) index of the session's motion, -1 between motions.
        segment: (m,) index of its segment, -1 if none or not known.
        jaws: (m,) last reading of the jaws, 0 open to 1 closed; NaN before the first.
        unhomed: number of samples left out because they precede the last homing, which resets the counts.
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
        sent_s: when its first line was sent, s since the log was opened.
        time_s: (m,) time of each point, if the unit neither stretches nor stops the motion.
        q: (m, 6) rad at the ends of segments.
        velocity: (m, 6) rad/s there; None if it jumps there. Cubic interpolation of these points and velocities gives
            exactly the segments.
    """

    sent_s: float
    time_s: Array
    q: Array
    velocity: Array | None


def unit_of(session: Session, name: str | None) -> Unit:
    """Return the unit of a session: the one named, the one noted in the log, or the one with its gripper axis.

    Raises:
        InputError: the unit cannot be determined, or the name is unknown, or another than that in the log; a noted unit
            file is wrong.
    """
    known = [(n.data, unit) for n in session.noted("run") if (unit := noted_unit(n.data)) is not None]
    given = None if name is None or (known and name == known[-1][1].name) else unit_called(name)
    if known:
        data, noted = known[-1]
        if given is not None and given.digest != noted.digest:
            why = f"--unit {name}: the log is of {noted.name}, and with another unit its counts are other angles"
            raise InputError(why, option="unit", value=name, log=noted.name)
        return noted.calibrated(data.get("joint_offsets_rad", np.zeros(AXES)))
    if given is not None:
        return given
    sent = {line.text.partition(":")[0] for line in session.sent}
    fitting = [u for u in map(load_unit, UNITS) if f"ANAXSETUP{u.gripper.axis}" in sent]
    if len(fitting) == 1:
        return fitting[0]
    why = f"{session.file}: does not name its unit; give --unit, one of {', '.join(UNITS)}, or its file"
    raise InputError(why, file=str(session.file), choices=list(UNITS))


def executed(session: Session, unit: Unit) -> Executed:
    """Return the position samples since the last homing.

    Raises:
        InputError: the log has none.
    """
    homed_s = session.homed_s
    homed = [s for s in session.samples if s.heard_s > homed_s and len(s.position.counts) == AXES]
    samples, last_s = [], -np.inf
    for sample in homed:
        if sample.time_s > last_s:
            samples.append(sample)
            last_s = sample.time_s
    if not samples:
        raise InputError(f"{session.file}: has no position sample of a homed arm", file=str(session.file))
    at = {id(s): (i, m.segment_of(s)) for i, m in enumerate(session.motions) for s in m.samples}
    places = [at.get(id(s), (-1, None)) for s in samples]
    times = np.array([s.time_s for s in samples])
    q = unit.positions([s.position.counts for s in samples])
    velocity = np.gradient(q, times, axis=0) if len(times) > 1 else np.zeros_like(q)
    set_up = (line.time_s for line in session.sent if line.text.startswith("ANAXSETUP"))
    set_up_s = max(set_up, default=-math.inf)  # earlier readings of the axis are not those of the jaws
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
    """Return every sent motion with a known start, in order, each truncated at the start of the next."""
    found = []
    for motion in session.motions:
        made = _absolute(motion, unit) if motion.target is not None else _stream(motion, unit)
        if made is not None:
            found.append(made)
    followings = [*(m.time_s[0] for m in found[1:]), np.inf][: len(found)]
    cut = (_before(m, end_s) for m, end_s in zip(found, followings, strict=True))
    return tuple(m for m in cut if len(m.time_s))


def _absolute(motion: LoggedMotion, unit: Unit) -> Planned | None:
    """An absolute motion, from rest to rest. The unit alone determines its duration, so it ends with the answer R!."""
    start, target, ready_s = motion.start, motion.target, motion.ready_s
    if start is None or target is None or ready_s is None or ready_s <= motion.sent_s:
        return None
    q = unit.positions([start, target])
    times = frozen([motion.sent_s, ready_s])
    return Planned(motion.sent_s, times, frozen(q), frozen(np.zeros_like(q)))


def _stream(motion: LoggedMotion, unit: Unit) -> Planned | None:
    path = motion.path
    if path is None:
        return None
    times = motion.begin_s + path.knot_times()
    velocity = None
    if not path.has_velocity_jumps:  # neighbouring segments differ by rounding only
        at_knots = [*(s.derivative(0.0) for s in path.segments), path.segments[-1].derivative(1.0)]
        velocity = frozen(np.stack(at_knots) / unit.counts_per_rad)
    return Planned(motion.sent_s, frozen(times), frozen(unit.positions(path.knots())), velocity)


def _before(motion: Planned, end_s: float) -> Planned:
    """The part of a motion before `end_s`, when the next one began."""
    keep = motion.time_s < end_s
    velocity = None if motion.velocity is None else frozen(motion.velocity[keep])
    return replace(motion, time_s=frozen(motion.time_s[keep]), q=frozen(motion.q[keep]), velocity=velocity)
