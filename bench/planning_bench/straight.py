"""Straight joint moves from rest to rest, all joints in step: exact trapezoids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.controller.unit import Limits
from arm.se3 import Array


@dataclass(frozen=True)
class Straight:
    """A straight joint move under a trapezoid (or triangle) of speed.

    Attributes:
        q_from, q_to: (6,) rad.
        top, push: largest rate of the way's fraction and of that rate, 1/s and 1/s^2.
    """

    q_from: Array
    q_to: Array
    top: float
    push: float

    @property
    def ramp(self) -> float:
        """Time of each ramp, s."""
        return self.top / self.push

    @property
    def duration(self) -> float:
        return 1.0 / self.top + self.ramp

    def at(self, times: Array) -> Array:
        """(m, 6) rad at times (m,) s."""
        t, end, ramp = np.clip(times, 0.0, self.duration), self.duration, self.ramp
        up = 0.5 * self.push * np.minimum(t, ramp) ** 2
        flat = self.top * np.clip(t - ramp, 0.0, end - 2 * ramp)
        down = np.maximum(t - (end - ramp), 0.0)
        s = up + flat + self.top * down - 0.5 * self.push * down**2
        return self.q_from + s[:, None] * (self.q_to - self.q_from)


def straight(q_from: Array, q_to: Array, limits: Limits) -> Straight:
    """The fastest straight move."""
    way = np.maximum(np.abs(q_to - q_from), 1e-12)
    top, push = float((limits.velocity / way).min()), float((limits.acceleration / way).min())
    return Straight(q_from, q_to, min(top, float(np.sqrt(push))), push)
