"""Arms as laboratories have them: joints that scatter, gears out of true, links that sag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array
from calib.hand_eye.chain import SmoothError
from recorded.arm_sets import Truth


@dataclass(frozen=True, eq=False)
class RealArm:
    """An arm whose joints are not where its readings say.

    Attributes:
        truth: zeros, links, camera and mount.
        scatter: standard deviation of each joint's rest, (6,) rad, drawn anew at every pose.
        runout: of the gears, once per turn: amplitude and phase of each joint, (6, 2) rad.
        sag: of J2 and J3, (2,) rad at most.
        noise_px: of a corner's coordinate.
    """

    truth: Truth
    scatter: Array
    runout: Array
    sag: Array
    noise_px: float

    def joints(self, readings: Array) -> Array:
        """Where the joints are without scatter, (n, 6) rad, from readings."""
        q = readings + self.runout[:, 0] * np.sin(readings + self.runout[:, 1])
        upper, fore = np.sin(readings[:, 1]), np.sin(readings[:, 1] + readings[:, 2])
        q[:, 1] += self.sag[0] * (0.6 * upper + 0.4 * fore)
        q[:, 2] += self.sag[1] * fore
        return np.asarray(q)

    def rest(self, readings: Array, rng: np.random.Generator) -> Array:
        """Where the joints come to rest, (n, 6) rad."""
        return np.asarray(self.joints(readings) + self.scatter * rng.standard_normal(readings.shape))

    def wave(self, error: SmoothError) -> float:
        """Coefficient of one of the model's smooth errors, rad."""
        size, phase = self.runout[error.joint]
        if sum(map(bool, error.angles)) > 1:
            of_sag = (0.4 * self.sag[0], self.sag[1])[error.joint - 1]
            return float(of_sag if error.wave == "sine" else 0.0)
        own = 0.6 * self.sag[0] if error.joint == 1 else 0.0
        return float(size * np.cos(phase) + own if error.wave == "sine" else size * np.sin(phase))


def draw_real_arm(rng: np.random.Generator, truth: Truth) -> RealArm:
    """Scatter of each joint 0.002 to 0.02 deg and noise of corners 0.02 to 0.3 px, both evenly by their logarithms;
    gears out of true by 0.01 deg at any phase; sag of J2 and J3 up to 0.03 deg."""

    def log_uniform(low: float, high: float, count: int) -> Array:
        return np.exp(rng.uniform(np.log(low), np.log(high), count))

    runout = np.stack([np.full(6, np.radians(0.01)), rng.uniform(0.0, 2.0 * np.pi, 6)], axis=1)
    return RealArm(
        truth,
        np.radians(log_uniform(0.002, 0.02, 6)),
        runout,
        np.radians(rng.uniform(0.0, 0.03, 2)),
        float(log_uniform(0.02, 0.3, 1)[0]),
    )
