"""Judge a trajectory of another program: shares of limits, the clearance that is proved, and why it is refused."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from arm.controller.segments import cubic_position_range
from arm.controller.unit import Limits
from arm.errors import ImpossibleError
from arm.se3 import Array
from cell.foreign.trajectory_file import JointTrajectory
from plan.collision.bezier import Curve
from plan.collision.certificate import ClearanceCertificate, certify_curve
from plan.collision.world import World
from plan.failure import nearness
from plan.trajectory.extremes import cubic_peaks

CLEAR, REFUTED, UNDECIDED, BEYOND = VERDICTS = ("clear", "refuted", "undecided", "beyond limits")
PARTS = 8  # into which what is not decided at once is cut
SLACK = 1e-9  # of limits, relative
SCAN, MOST_SCANNED = 0.02, 1000  # rad or m, and number of samples
MOMENT_S = 5e-4
# Times are probably in another unit beyond these: a factor, a share of the velocity limits, and a duration.
MOST_SLOWER, LEAST_SHARE, LONG_S = 50.0, 1e-3, 300.0
_AGAINST = 0.5  # cosine between stated velocities and motion, of which the negative is rather a wrong sign
_FAR = 10.0  # ranges of a joint beyond its limits, where a unit is rather wrong than a motion
STEEPER = (35.0, 90.0)  # between which velocities are rather in deg/s: 57.3 times those in rad/s
TIMES = "time_from_start is in s, by sec and nanosec"


@dataclass(frozen=True)
class Asked:
    """What a trajectory has to keep.

    Attributes:
        clearance: m.
        speed: allowed fraction of the limits.
        in_deg: whether joints are told in deg; if not, in rad, m where a joint slides.
    """

    clearance: float
    speed: float
    in_deg: bool


@dataclass(frozen=True, eq=False)
class Peaks:
    """Largest shares of the limits that a trajectory needs, each (n,); 1 is the limit.

    Attributes:
        velocity, acceleration: of each joint; acceleration None if joints move on straight lines with corners.
        beyond: by how much positions are beyond their limits, rad (m); at most 0 if they are not.
        duration: of the trajectory, s.
        steeper: how many times the velocities at the points are those of the positions, rms; NaN if not known.
        along: cosine between the velocities at inner points and those from point to point; NaN if not known.
        meant: in which unit the positions of the joint farthest beyond its limits may be; "" if not known.
    """

    velocity: Array
    acceleration: Array | None
    beyond: Array
    duration: float
    steeper: float = np.nan
    meant: str = ""
    along: float = np.nan

    def in_deg(self) -> str:
        """Say that the velocities may be in deg/s, or of the other sign, or are all 0; "" if they go with positions."""
        if self.along < -_AGAINST:
            return " (have the velocities the other sign? They are against the motion from point to point)"
        if self.steeper == 0.0:
            return " (the velocities of all inner points are 0: the arm stops at each of them)"
        if not STEEPER[0] < self.steeper < STEEPER[1]:
            return ""
        return f" (are the velocities in deg/s? They are {self.steeper:.0f} times those from point to point)"

    def slow(self) -> str:
        """Say that nothing moves, or so slowly that times may be in another unit; "" if neither is so."""
        most = float(self.velocity.max())
        if most == 0.0:
            return "no joint moves: the positions of all its points are the same"
        if self.along < -_AGAINST:
            return self.in_deg().strip(" ()")
        if not 0.0 < most < LEAST_SHARE or self.duration < LONG_S:
            return ""
        return (
            f"it lasts {self.duration:.4g} s, and no joint needs more than {100.0 * most:.2g} % of its velocity limit: "
            f"are its times in another unit? {TIMES}"
        )


def peaks_of(trajectory: JointTrajectory, limits: Limits) -> Peaks:
    """Return the shares of limits that a trajectory needs, exactly, between its points too."""
    a, lasts = trajectory.coefficients, np.diff(trajectory.times)[:, None]
    low, high = trajectory.q[:-1] + cubic_position_range(a)
    velocity, acceleration, _ = cubic_peaks(a, lasts)
    beyond = np.maximum(limits.lower - low.min(axis=0), high.max(axis=0) - limits.upper)
    push = None if trajectory.velocity is None else acceleration.max(axis=0) / limits.acceleration
    share = velocity.max(axis=0) / limits.velocity
    steeper, along = _steeper(trajectory)
    return Peaks(
        share,
        push,
        beyond,
        trajectory.duration,
        steeper,
        _meant(trajectory, limits, beyond),
        along,
    )


def _meant(trajectory: JointTrajectory, limits: Limits, beyond: Array) -> str:
    """Say in which unit the positions may be of the joint that is farthest beyond its limits, or that turns too far."""
    k = int(beyond.argmax())
    far, low, high = float(beyond[k]), float(limits.lower[k]), float(limits.upper[k])
    if far <= 0.0:
        return ""
    q, turn = trajectory.q[:, k], 2.0 * np.pi

    def within(values: Array) -> bool:
        return bool((low <= values.min()) and (values.max() <= high))

    if far > turn and within(np.radians(q)):
        return " (are these degrees? positions are in rad)"
    if far > _FAR * (high - low) and within(q / 1e3):
        return " (a thousandth would be within: positions are in rad, m where a joint slides)"
    outside = q[(q < low) | (q > high)]
    if len(outside) and within(outside - np.sign(outside) * turn):
        return " (less a whole turn it would be within)"
    return ""


def _steeper(trajectory: JointTrajectory) -> tuple[float, float]:
    """How many times the stated velocities at inner points are those from the point before to the one after, rms; and
    the cosine between both."""
    if trajectory.velocity is None or len(trajectory.times) < 3:
        return np.nan, np.nan
    slopes = (trajectory.q[2:] - trajectory.q[:-2]) / (trajectory.times[2:] - trajectory.times[:-2])[:, None]
    moved, stated = (float(np.sqrt(np.square(rates).sum())) for rates in (slopes, trajectory.velocity[1:-1]))
    if moved == 0.0:
        return np.nan, np.nan
    together = float((slopes * trajectory.velocity[1:-1]).sum())
    return stated / moved, together / (stated * moved) if stated > 0.0 else np.nan


def certified(world: World, curve: Curve, clearance: float) -> ClearanceCertificate:
    """Prove or refute the clearance of a chain of cubics, each apart where it is not decided as a whole.

    A certificate that is not proved and has seen no distance below the clearance is undecided.
    """
    whole = certify_curve(world, curve, clearance, tight=True)
    if whole.proved or whole.seen < clearance:
        return whole
    begins = np.concatenate([[0.0], curve.ends[:-1]])
    open_ = np.flatnonzero(np.array(whole.bounds) < clearance)
    found = whole
    bounds = np.array(whole.bounds)
    for k in open_:
        part = _cut(curve.control[k], begins[k], curve.ends[k])
        check = certify_curve(world, part, clearance, tight=False)
        bounds[k] = check.clearance
        if check.seen < found.seen:
            found = replace(found, seen=check.seen, pair=check.pair, time=begins[k] + check.time)
        if found.seen < clearance:
            break
    least = min(float(bounds.min()), found.seen)
    return replace(found, clearance=least, proved=least >= clearance, bounds=tuple(bounds.tolist()))


def _cut(control: Array, begin: float, end: float) -> Curve:
    """Return a cubic (4, n) as `PARTS` cubics; time from its begin."""
    cuts = np.linspace(0.0, 1.0, PARTS + 1)
    p0, p1, p2, p3 = control
    a1, a2, a3 = 3.0 * (p1 - p0), 3.0 * (p0 - 2.0 * p1 + p2), p3 - 3.0 * p2 + 3.0 * p1 - p0
    parts = []
    for u, v in pairwise(cuts):
        h = v - u
        start = p0 + u * (a1 + u * (a2 + u * a3))
        b1, b2, b3 = h * (a1 + u * (2.0 * a2 + 3.0 * u * a3)), h**2 * (a2 + 3.0 * u * a3), h**3 * a3
        parts.append([start, start + b1 / 3.0, start + (2.0 * b1 + b2) / 3.0, start + b1 + b2 + b3])
    return Curve(np.array(parts), cuts[1:] * (end - begin))


def refusal_of(
    file: Path, joints: Sequence[str], asked: Asked, peaks: Peaks, check: ClearanceCertificate
) -> ImpossibleError | None:
    """Return why limits or clearance are not kept, or are not decided; None if they are kept.

    Args:
        file: of the trajectory, for the message.
        joints: their names.
        asked: what is required.
        peaks, check: what was found.
    """
    also = _clearance_words(check, asked)
    if (peaks.beyond > SLACK).any():
        joint = int(peaks.beyond.argmax())
        beyond = float(peaks.beyond[joint])
        by = f"{np.degrees(beyond):.4g} deg" if asked.in_deg else f"{beyond:.3g} rad (m)"
        meant = peaks.meant or peaks.in_deg()
        why = f"{file}: {joints[joint]} is beyond its position limits by {by}{meant}; {also}"
        return ImpossibleError(why, verdict=BEYOND, joint=joints[joint], beyond=beyond)
    for what, share in (("velocity", peaks.velocity), ("acceleration", peaks.acceleration)):
        joint = 0 if share is None else int(share.argmax())  # NaN counts as the largest
        if share is not None and not share[joint] <= 1.0 + SLACK:
            slower = share[joint] if what == "velocity" else np.sqrt(share[joint])
            needs = f"{100.0 * share[joint]:.0f} % of its {what} limit at speed {asked.speed:g}"
            # rounded up, so that the advice suffices
            slow, most = np.ceil(100.0 * slower) / 100.0, np.ceil(100.0 * asked.speed * slower) / 100.0
            if in_deg := peaks.in_deg():
                also = f"{in_deg.strip(' ()')}; {also}"
            elif slower > MOST_SLOWER:
                also = f"it lasts {peaks.duration:.3g} s: are its times in another unit? {TIMES}; {also}"
            faster = f", or give --speed {most:g}" if most <= 1.0 else ""
            why = f"{file}: {joints[joint]} needs {needs}; make the trajectory {slow:.2f} times as slow{faster}; {also}"
            return ImpossibleError(
                why, verdict=BEYOND, joint=joints[joint], limit=what, share=float(share[joint])
            )
    if check.proved:
        return None
    if check.seen < asked.clearance:
        why, verdict = f"{file}: refuted: {also}", REFUTED
    else:
        verdict = UNDECIDED
        why = (
            f"{file}: undecided: {1e3 * check.clearance:.2f} mm are proved, {1e3 * asked.clearance:g} mm are required, "
            f"and nothing nearer than {1e3 * check.seen:.2f} mm was seen; give a lower --clearance-mm"
        )
    return ImpossibleError(
        why,
        verdict=verdict,
        pair=list(check.pair),
        distance_m=check.seen,
        proved_m=check.clearance,
        time_s=check.time,
    )


def _clearance_words(check: ClearanceCertificate, asked: Asked) -> str:
    """Return what was found of the clearance."""
    if check.proved:
        return f"its clearance of {1e3 * asked.clearance:g} mm is proved"
    if check.seen < asked.clearance:
        return f"{check.time:.3f} s after the start {nearness(check.pair, check.seen, asked.clearance)}"
    return "its clearance is not decided"


def first_lost(
    world: World, trajectory: JointTrajectory, clearance: float, check: ClearanceCertificate
) -> ClearanceCertificate:
    """Return a refuted certificate with the first moment at which the clearance is seen to be lost, to a millisecond.

    Between samples, every `SCAN` rad (m) of the fastest joint, it may be lost for a shorter while before.
    """
    most = float(np.abs(np.diff(trajectory.q, axis=0)).sum(axis=0).max())
    times = np.linspace(0.0, check.time, min(2 + int(most / SCAN), MOST_SCANNED))
    for low, high in zip([0.0, *times], times, strict=False):
        if world.distance(trajectory.at(np.array([high]))[0][0]).value < clearance:
            while high - low > MOMENT_S:
                middle = (low + high) / 2.0
                lost = world.distance(trajectory.at(np.array([middle]))[0][0]).value < clearance
                low, high = (low, middle) if lost else (middle, high)
            found = world.distance(trajectory.at(np.array([high]))[0][0])
            return replace(check, seen=found.value, pair=found.pair, time=float(high))
    return check
