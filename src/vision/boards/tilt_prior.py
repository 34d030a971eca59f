"""Prior on the tilt of boards: their stands have a few known tilts, such as 0, 7 and 15 degrees.

The prior is a hypothesis, which is tested and never forced. A tilt is a vector in the direction of the lean. So all
tilts of one angle form a ring (a point for 0), blurred by the pose's covariance. The alternative is any other tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import i0e

from arm.poses import BoardPose, TiltHypothesis
from arm.se3 import Array

STANDS = np.radians(0.5)  # standard deviation of the stands, and of the vertical in the camera's extrinsics
STEEPEST = np.radians(45.0)  # largest tilt of a board with any tilt
ANYWHERE = 0.5  # prior probability of a board with any tilt
FITS_SIGMAS = 3.0
MOST_SAY = np.log(10.0)  # largest log odds from the prior: never enough to overrule the images


@dataclass(frozen=True)
class _Tilt:
    """Tilt of a board, rad; its variance along the lean, and the mean variance of both axes; both include `STANDS`."""

    angle: float
    along: float
    mean: float

    @classmethod
    def of(cls, pose: BoardPose) -> _Tilt:
        up = pose.T_base_board[2, :3]  # in the board's frame
        C = pose.covariance[3:5, 3:5]
        turn = np.array([up[1], -up[0]])  # a rotation about this axis increases the lean
        mean = float(np.trace(C)) / 2.0
        length = float(np.linalg.norm(turn))
        along = mean if length < 1e-9 else float(turn @ C @ turn) / length**2
        return cls(pose.tilt(), along + STANDS**2, mean + STANDS**2)

    def log_density(self, tilt: float) -> float:
        """Log density of this tilt vector (per rad^2) if the board has this `tilt` in any direction."""
        variance = self.along if tilt > 0.0 else self.mean
        ring = np.log(i0e(self.angle * tilt / variance))
        return float(ring - (self.angle - tilt) ** 2 / (2.0 * variance) - np.log(2.0 * np.pi * variance))

    def sigmas(self, tilt: float) -> float:
        return (self.angle - tilt) / float(np.sqrt(self.along if tilt > 0.0 else self.mean))


def _densities(pose: BoardPose, tilts: Sequence[float]) -> Array:
    """Prior times density of each tilt, and of any other tilt (last)."""
    tilt = _Tilt.of(pose)
    members = [(1.0 - ANYWHERE) / len(tilts) * np.exp(tilt.log_density(t)) for t in tilts]
    return np.array([*members, ANYWHERE / (np.pi * STEEPEST**2)])


def tilt_hypothesis(pose: BoardPose, tilts: Sequence[float]) -> TiltHypothesis:
    """Test which of `tilts` (rad) the pose agrees with, if any."""
    tilt, densities = _Tilt.of(pose), _densities(pose, tilts)
    nearest = int(np.argmin([abs(tilt.sigmas(t)) for t in tilts]))
    z, probability = tilt.sigmas(tilts[nearest]), float(densities[nearest] / densities.sum())
    return TiltHypothesis(float(tilts[nearest]), float(z), probability, bool(abs(z) <= FITS_SIGMAS))


def log_odds_of_tilts(first: BoardPose, second: BoardPose, tilts: Sequence[float]) -> float:
    """Log odds of the first of two poses over the second from the prior, at most `MOST_SAY` either way."""
    a, b = (float(np.log(_densities(pose, tilts).sum())) for pose in (first, second))
    return float(np.clip(a - b, -MOST_SAY, MOST_SAY))
