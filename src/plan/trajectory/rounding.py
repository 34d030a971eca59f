"""Rounding of cubics to integer counts such that velocity and acceleration limits hold exactly.

A segment of duration T moves a joint by a1 u + a2 u^2 + a3 u^3 counts. With p = a2 and r = a2 + 3 a3, its acceleration
is 2 p / T^2 at the beginning, 2 r / T^2 at the end, and linear between. The limit is |p|, |r| <= L, an integer. For a
displacement D, p and a3 are chosen within the limit and near the planned values, and a1 = D - p - a3 takes the rest. So
positions at joins are the planned ones, to the count, and velocities jump there by a few counts per segment, within the
controller's vertex rule (docs/sources.md, "Coordinated motion", row 10).

If no choice keeps all limits, positions at joins may shift by up to 4 counts. Dynamic programming over the chain finds
the shifts, for each joint separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Counts, Limits, Unit
from arm.se3 import Array, Bools

VERTEX_S = 5e-3  # s; vertex rule: at a join the velocity jumps by at most this times the acceleration limit
_SHARE = 0.48  # of that jump, for each of the two sides of a join
_LEAST = 0.75  # counts per segment, least tolerance of a velocity; nearest rounding needs 0.5
_SHIFTS = np.arange(-4, 5)  # counts, shifts of the position at a join
_STEPS = np.array([(dp, da) for dp in range(-1, 2) for da in range(-1, 2)])
# Costs are integers, so that their sums are the same on every processor.
_FINE = 10_000
_NEVER = 1e12


def vertex_jump(acceleration: Array, speed: float = 1.0) -> Array:
    """Return the largest jump of velocity at a join that the controller allows, (n,) rad/s: `COORDDISCONT`.

    Args:
        acceleration: limits (n,) rad/s^2 at `speed`.
        speed: factor that they were scaled by, squared; the controller's rule knows its registers alone.
    """
    return np.asarray(VERTEX_S * acceleration / speed**2)


def round_chain(
    unit: Unit, limits: Limits, knots_ms: Counts, q: Array, qd: Array, careful: bool = True
) -> Counts:
    """Round the chain of cubics with these positions and velocities at its knots, at rest at both ends.

    Args:
        unit: unit that defines the counts.
        limits: limits of velocity and acceleration.
        knots_ms: (k + 1,) times.
        q, qd: (k + 1, n) rad and rad/s.
        careful: shift positions at joins where needed; this takes five times as long.

    Returns:
        Coefficients (3, k, n). A joint for which no choice keeps the limits is rounded to nearest in all segments and
        exceeds its limits.
    """
    duration = np.diff(knots_ms)[:, None] / 1e3
    speed = qd * unit.counts_per_rad
    chooser = _Chooser(
        begin=speed[:-1] * duration,
        end=speed[1:] * duration,
        most=_whole(limits.velocity, 1.0 / duration, unit),
        push=_whole(limits.acceleration, 2.0 / duration**2, unit),
        jump=np.maximum(
            _SHARE * VERTEX_S * limits.acceleration * np.abs(unit.counts_per_rad) * duration, _LEAST
        ),
    )
    step = np.diff(unit.counts(q), axis=0).astype(float)
    chosen = chooser.choose(step)
    stuck = ~(chosen[3] < _NEVER).all(axis=0)
    if careful and stuck.any():
        chosen[:, :, stuck] = _shifted(chooser.only(stuck), step[:, stuck])
        stuck = ~(chosen[3] < _NEVER).all(axis=0)
    # round joints that cannot keep their limits to nearest, so that the caller can measure the excess
    v0, v1 = np.rint(chooser.begin), np.rint(chooser.end)
    nearest = np.stack([v0, 3 * step - 2 * v0 - v1, v0 + v1 - 2 * step])
    chosen[:3, :, stuck] = nearest[:, :, stuck]
    return chosen[:3].astype(np.int64)


def _whole(limit: Array, scale: Array, unit: Unit) -> Array:
    """Return the largest whole counts (k, n) that, times `scale`, are within a limit to the last bit."""
    counts = np.abs(unit.counts_per_rad)
    whole = np.floor(limit * counts / scale + 1e-6)
    return np.asarray(whole - (whole * scale / counts / limit > 1.0))


@dataclass(frozen=True, eq=False)
class _Chooser:
    """Planned velocities `begin`, `end` of segments and their limits, all (k, n) in counts per segment.

    `most` limits the velocity, `push` is the limit L of |p| and |r|, and `jump` the tolerance of `begin` and `end`.
    """

    begin: Array
    end: Array
    most: Array
    push: Array
    jump: Array

    def only(self, joints: Bools) -> _Chooser:
        """Return the chooser of some of the joints."""
        return _Chooser(*(x[:, joints] for x in (self.begin, self.end, self.most, self.push, self.jump)))

    def choose(self, D: Array) -> Array:
        """Return a1, a2, a3 and cost (4, ..., k, n) of the best choice for displacements D (..., k, n)."""
        first = np.clip(3 * D - 2 * self.begin - self.end, -self.push, self.push)
        last = np.clip(-3 * D + self.begin + 2 * self.end, -self.push, self.push)
        along = (slice(None), *(None,) * D.ndim)
        p = np.rint(first) + _STEPS[:, 0][along]
        a3 = np.rint((last - p) / 3) + _STEPS[:, 1][along]
        # exactly at rest at both ends: a1 = 0, and a1 + 2 a2 + 3 a3 = 0
        a3[..., 0, :] = D[..., 0, :] - p[..., 0, :]
        if D.shape[-2] > 1:
            a3[..., -1, :] = -(D[..., -1, :] + p[..., -1, :]) / 2
        r = p + 3 * a3
        a1 = D - p - a3
        v = a1 + p + r
        early, late = np.abs(a1 - self.begin), np.abs(v - self.end)
        bad = np.maximum(np.abs(p), np.abs(r)) > self.push
        bad |= np.maximum(early, late) > self.jump
        bad |= np.maximum(np.abs(a1), np.abs(v)) > self.most
        bad |= a3 != np.rint(a3)
        # the velocity is extreme inside if the acceleration changes sign
        inside = (p * r < 0) & ~bad
        most = np.broadcast_to(self.most, p.shape)[inside]
        bad[inside] = np.abs(a1[inside] - p[inside] ** 2 / (3 * a3[inside])) > most
        cost = (early**2 + late**2) / self.jump**2 + ((p - first) / np.maximum(self.push, 1.0)) ** 2
        cost = np.where(bad, _NEVER, np.rint(_FINE * cost))
        best = np.argmin(cost, axis=0)[None]
        return np.concatenate([np.take_along_axis(x, best, 0) for x in (a1, p, a3, cost)])


def _shifted(chooser: _Chooser, step: Array) -> Array:
    """`_Chooser.choose`, with positions at joins shifted by counts where limits need it."""
    reach = int(_SHIFTS[-1] - _SHIFTS[0])
    options = chooser.choose(step + np.arange(-reach, reach + 1)[:, None, None])
    # index into options: from a shift (row) to a shift (column)
    change = reach + _SHIFTS[None, :] - _SHIFTS[:, None]
    price = options[3][change].astype(np.int64) + (_FINE // 10) * _SHIFTS[None, :, None, None] ** 2
    count, joints = step.shape
    still = int(np.flatnonzero(_SHIFTS == 0)[0])
    total = np.full((len(_SHIFTS), joints), count * int(_NEVER), dtype=np.int64)
    total[still] = 0
    origins = []
    for i in range(count):
        costs = total[:, None] + price[:, :, i]
        origins.append(costs.argmin(axis=0))
        total = costs.min(axis=0)
    shift = np.full(joints, still)
    chosen, each = np.empty((4, count, joints)), np.arange(joints)
    for i in range(count - 1, -1, -1):
        before = origins[i][shift, each]
        chosen[:, i] = options[:, change[before, shift], i, each]
        shift = before
    return chosen
