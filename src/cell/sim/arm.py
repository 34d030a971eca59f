"""Errors of a true arm that its encoders do not read, added to the positions that they read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.robot.dh import A465
from arm.se3 import Array
from cell.files.world import World

_ECCENTRICITY, _SCATTER = 5, 6  # what a sequence of random numbers is for
AT_REST = (0, 0, 0, 0, 0, 0)


@dataclass(frozen=True)
class Arrival:
    """How the arm came to where it is.

    Attributes:
        time_ms: emulated time of its last motion; 0 before any.
        directions: sign of each joint's last motion, 0 before any.
    """

    time_ms: int = 0
    directions: tuple[int, ...] = AT_REST


class JointErrors:
    """True joint positions less those that the encoders read, of one arm.

    Args:
        world: amplitudes and seeds.
    """

    def __init__(self, world: World) -> None:
        self._arm, self._seed = world.arm, world.seed
        rng = np.random.default_rng([world.build_seed, _ECCENTRICITY])
        self._phase = rng.uniform(0.0, 2.0 * np.pi, 6)
        keys = (self._arm.scatter, self._arm.backlash)
        self.depends_on_arrival = any(bool(np.any(values)) for values in keys)

    def at(self, q: Array, arrival: Arrival, now_ms: int) -> Array:
        """Errors (6,) rad at positions `q` (6,) rad, reached by `arrival`, at the emulated time `now_ms`."""
        errors = self.steady(q, now_ms)
        if self.depends_on_arrival:
            for part in self.of_arrival(arrival):
                errors += part
        return errors

    def steady(self, q: Array, now_ms: npt.ArrayLike) -> Array:
        """The part of them that any arrival has in common, for positions (..., 6) at times (...,) ms."""
        arm = self._arm
        errors: Array = arm.eccentricity * np.sin(q + self._phase)
        errors[..., 1:3] += arm.sag * leverage(q)
        errors += arm.warm_up * -np.expm1(-np.asarray(now_ms)[..., None] / 1e3 / arm.warm_up_s)
        return errors

    def along(self, q: Array, time_ms: npt.NDArray[np.int64]) -> Array:
        """Errors (m, 6) rad of an arm that moves, at positions q (m, 6) of every ms of its motions (m,).

        Each joint lags behind its present motion. Between two arrivals scatter changes linearly from one to the other.
        """
        errors = self.steady(q, time_ms)
        if not self.depends_on_arrival or len(q) == 0:
            return errors
        ends = np.flatnonzero(np.diff(time_ms, append=time_ms[-1] + 2) > 1)
        drawn = np.array([self.of_arrival(Arrival(int(t)))[1] for t in (0, *time_ms[ends])])
        begins = np.concatenate([[0], ends[:-1] + 1])
        for begin, end, before, after in zip(begins, ends, drawn, drawn[1:], strict=False):
            share = np.linspace(0.0, 1.0, end - begin + 1)[:, None]
            errors[begin : end + 1] += (1.0 - share) * before + share * after
        return errors - 0.5 * self._arm.backlash * _directions(q)

    def of_arrival(self, arrival: Arrival) -> tuple[Array, Array]:
        """The parts that differ from one to the next: backlash, and scatter by the seed and the time of the arrival."""
        rng = np.random.default_rng([self._seed, _SCATTER, arrival.time_ms])
        backlash = -0.5 * self._arm.backlash * np.array(arrival.directions)
        return backlash, self._arm.scatter * rng.standard_normal(6)


def leverage(q: Array) -> Array:
    """Gravity's lever on J2 and J3, (..., 2), at positions (..., 6), from -1 to 1.

    It is 1 with the arm, or the forearm, stretched out level forwards. The load is taken to be at the wrist, so
    the lever is its horizontal distance from the joint's axis.
    """
    upper, fore = A465.a[1], A465.d[3]
    at_elbow = fore * np.sin(q[..., 1] + q[..., 2])
    return np.stack([(upper * np.sin(q[..., 1]) + at_elbow) / (upper + fore), at_elbow / fore], axis=-1)


def _directions(q: Array) -> Array:
    """Sign of each joint's last motion at each of the positions (m, 6), 0 before any."""
    signs = np.sign(np.diff(q, axis=0, prepend=q[:1]))
    last = np.maximum.accumulate(np.where(signs != 0.0, np.arange(len(q))[:, None], 0), axis=0)
    return np.take_along_axis(signs, last, axis=0)
