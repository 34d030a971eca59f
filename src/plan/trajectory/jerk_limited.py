"""Jerk-limited time parametrisation of joint paths, from rest to rest: slower, but gentler on gears.

On a straight piece in joint space all joints move in proportion (phase synchronisation). The fastest jerk-limited
motion is then one scalar profile under the tightest of the joints' limits: Ruckig's with one degree of freedom
(L. Berscheid, T. Kroeger, "Jerk-limited real-time trajectory generation with arbitrary target states", RSS 2021).

On a curve, jerk is q' s''' + 3 q'' s' s'' + q''' s'^3. The scalar profile under the limits of a straight piece is
stretched in time until limits hold on the curve. The result is valid, not optimal.

**The motion stops wherever the path's second derivative jumps** (at a corner, at each end of a parabolic blend, at the
end of a line), because the acceleration would jump there at any speed. So give a chained path a small `blend` if it
is to have a jerk limit; the motion then stops about once per corner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import ruckig

from arm.controller.unit import Limits
from arm.errors import ImpossibleError, InputError
from arm.se3 import Array, frozen
from plan.trajectory.joint_path import Path
from plan.trajectory.timing import Caps, Trajectory, rate_caps

_SAMPLES = 400  # places between knots where limits are checked
_ROOM = 1.001  # factor on sampled loads, which may be slightly larger between samples


@dataclass(frozen=True, eq=False)
class JerkTrajectory(Trajectory):
    """A trajectory with constant third derivative of s between knots.

    Attributes:
        drive: (k,) second derivative of s with respect to time at the knots.
        jerk: (n,) limits, rad/s^3.
    """

    drive: Array = field(kw_only=True)
    jerk: Array = field(kw_only=True)

    def jerks(self, times: npt.ArrayLike) -> Array:
        """Return the jerk (m, n) rad/s^3 at times (m,) in s."""
        s, rate, drive, jerk = self._scalars(np.asarray(times, dtype=float))
        return np.asarray(
            self.path(s, 1) * jerk + 3 * self.path(s, 2) * rate * drive + self.path(s, 3) * rate**3
        )

    def stretched(self, factor: float) -> Trajectory:
        """See `Trajectory.stretched`."""
        return replace(super().stretched(factor), drive=frozen(self.drive / factor**2))  # type: ignore[call-arg]

    def under(self, limits: Limits) -> Trajectory:
        """See `Trajectory.under`."""
        return time_smooth(self.path, limits, self.jerk, self.rate_cap)

    def switches(self) -> Array:
        """Return the times (k,) in s at which the jerk jumps, without both ends."""
        return np.asarray(self.times[1:-1])

    def passed(self, s: npt.ArrayLike) -> Array:
        """See `Trajectory.passed`; by bisection, to 1 ns."""
        places = np.clip(np.atleast_1d(np.asarray(s, dtype=float)), self.s[0], self.s[-1])
        low, high = np.zeros(len(places)), np.full(len(places), self.duration)
        while (high - low).max(initial=0.0) > 1e-9:
            middle = (low + high) / 2
            before = self._scalars(middle)[0] < places
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return np.asarray(high)

    def loads(self) -> tuple[Array, Array]:
        """See `Trajectory.loads`; the largest of samples between knots."""
        state = self.at(self._samples().ravel())
        shape = (len(self.times) - 1, -1)
        return (
            (np.abs(state.qd) / self.limits.velocity).max(axis=1).reshape(shape).max(axis=1),
            (np.abs(state.qdd) / self.limits.acceleration).max(axis=1).reshape(shape).max(axis=1),
        )

    def jerk_peak(self) -> float:
        """Return the largest jerk relative to its limit, sampled between knots and at both sides of path breaks."""
        inside = self.path.x[(self.path.x > self.s[0]) & (self.path.x < self.s[-1])]
        breaks = self.passed(inside)[:, None] + 1e-8 * np.array([-1.0, 1.0])
        times = np.concatenate([self._samples().ravel(), breaks.ravel()])
        return float((np.abs(self.jerks(times)) / self.jerk).max())

    def _samples(self) -> Array:
        inside = np.linspace(1e-6, 1.0 - 1e-6, _SAMPLES)
        return np.asarray(self.times[:-1, None] + inside * np.diff(self.times)[:, None])

    def _scalars(self, t: Array) -> tuple[Array, ...]:
        """See `Trajectory._scalars`; the third derivative, too."""
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, len(self.times) - 2)
        jerk = (np.diff(self.drive) / np.diff(self.times))[i]
        tau = t - self.times[i]
        drive = self.drive[i] + tau * jerk
        rate = self.rate[i] + tau * (self.drive[i] + tau * jerk / 2)
        s = self.s[i] + tau * (self.rate[i] + tau * (self.drive[i] / 2 + tau * jerk / 6))
        s = np.clip(s, self.s[i], self.s[i + 1])
        return s, np.maximum(rate, 0.0)[:, None], drive[:, None], jerk[:, None]


def time_smooth(path: Path, limits: Limits, jerk: npt.ArrayLike, rate_cap: Caps = None) -> JerkTrajectory:
    """Time a path from rest to rest under jerk limits, with a stop wherever its second derivative jumps.

    Args:
        path: see `plan.trajectory.joint_path`.
        limits: limits of velocity and acceleration.
        jerk: limits (n,), rad/s^3.
        rate_cap: see `plan.trajectory.timing.time_curve`.

    Raises:
        InputError: a jerk limit or cap is not positive.
        ImpossibleError: Ruckig finds no profile; data: result.
    """
    jerks = np.broadcast_to(np.asarray(jerk, dtype=float), limits.velocity.shape)
    if not (jerks > 0.0).all():
        raise InputError(f"jerk limit = {jerks.min():g}: must be positive", value=float(jerks.min()))
    caps = rate_caps(path, rate_cap)
    knots = [np.array([[0.0], [path.x[0]], [0.0], [0.0]])]  # times, s, rate, drive
    for begin, end in pairwise(_rests(path)):
        cap = float(caps[(path.x[:-1] < end) & (path.x[1:] > begin)].min())
        knots.append(
            _stretch(path, begin, end, limits, jerks, cap) + [[knots[-1][0, -1]], [0.0], [0.0], [0.0]]
        )
    times, s, rate, drive = np.concatenate(knots, axis=1)
    return JerkTrajectory(
        path,
        frozen(times),
        frozen(s),
        frozen(rate),
        limits,
        "ruckig",
        rate_cap,
        drive=frozen(drive),
        jerk=frozen(jerks),
    )


def _rests(path: Path) -> list[float]:
    """Return both ends of a path, and the places where its first or second derivative jumps."""
    x = path.x
    inside, length = x[1:-1], np.diff(x)
    power = np.arange(len(path.c) - 1, -1, -1.0)[:, None, None]
    jumps = np.zeros(len(inside), dtype=bool)
    for order, scale in ((1, 1.0), (2, float(length.mean()))):
        factor = np.prod([power - k for k in range(order)], axis=0)
        exponent = np.maximum(power - order, 0.0)
        ends = (factor * path.c * length[:, None] ** exponent).sum(axis=0)[:-1]
        largest = np.abs(path(x, 1)).max()
        jumps |= np.abs(ends - path(inside, order)).max(axis=1) * scale > 1e-6 * largest
    return [float(x[0]), *(float(at) for at in inside[jumps]), float(x[-1])]


def _stretch(path: Path, begin: float, end: float, limits: Limits, jerk: Array, cap: float) -> Array:
    """Return the knots (4, k), without the first, of the motion from rest to rest between two places."""
    places = np.linspace(begin, end, _SAMPLES + 2)[1:-1]
    slope = np.abs(path(places, 1)).max(axis=0)
    with np.errstate(divide="ignore"):
        bounds = [float((most / slope).min()) for most in (limits.velocity, limits.acceleration, jerk)]
    times, s, rate, drive = _profile(end - begin, min(bounds[0], cap), bounds[1], bounds[2])
    s = np.minimum(s + begin, end)
    s[-1] = end
    whole = JerkTrajectory(path, times, s, rate, limits, "ruckig", drive=drive, jerk=jerk)
    velocity, acceleration = whole.loads()
    straight = np.abs(path(places, 2)).max() == 0.0
    room = 1.0 if straight else _ROOM
    factor = max(
        1.0,
        room * float(velocity.max()),
        float(np.sqrt(room * acceleration.max())),
        math.cbrt(room * whole.jerk_peak()),
    )
    return np.stack([times * factor, s, rate / factor, drive / factor**2])[:, 1:]


def _profile(length: float, velocity: float, acceleration: float, jerk: float) -> Array:
    """Return times, s, rate and second derivative (4, k) of Ruckig's fastest profile over a length."""
    # Ruckig's tolerances are absolute, so scale length and velocity limit to 1
    second = length / velocity
    scaled = ruckig.InputParameter(1)
    scaled.current_position, scaled.target_position = [0.0], [1.0]
    scaled.max_velocity = [1.0]
    scaled.max_acceleration = [acceleration * second**2 / length]
    scaled.max_jerk = [jerk * second**3 / length]
    found = ruckig.Trajectory(1)
    result = ruckig.Ruckig(1).calculate(scaled, found)
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        why = f"Ruckig finds no jerk-limited profile ({result.name}); limits may be too far apart"
        raise ImpossibleError(why, result=result.name)
    profile = found.profiles[0][0]
    t = np.concatenate([[0.0], np.cumsum(profile.t)])
    p, v, a = (np.array(x, dtype=float) for x in (profile.p, profile.v, profile.a))
    keep = np.concatenate([[True], np.diff(t) > 1e-12])
    p[-1], v[-1], a[-1] = 1.0, 0.0, 0.0
    if not keep[-1]:
        keep[np.flatnonzero(keep)[-1]], keep[-1] = False, True
    return np.stack([t * second, p * length, v * velocity, a * length / second**2])[:, keep]
