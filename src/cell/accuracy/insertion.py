"""The probability that a released cube enters its pocket.

A cube enters if the square section of it at the plate's top lies inside the pocket's mouth, and if it leans little
enough that its lower edges find the funnel. Position, rotation and tilt are normally distributed, sizes too. The
probability is the share of a fixed set of quasi-random errors that enter (an additive recurrence, H. Weyl, 1916): the
same input gives the same result, with a resolution of 1 in `SAMPLES`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri

from arm.board import CAPTURE_TILT
from arm.numerics.products import mul
from arm.se3 import Array, Bools, frozen

SAMPLES = 2**15  # leaves errors of some 3e-4 in the middle, less near 0 and 1
_X, _Y, _TURN_X, _TURN_Y, _YAW = 0, 1, 3, 4, 5  # of a twist in the hole's frame
_CERTAIN = 5.0  # standard deviations: if the cube enters with all errors at once as large, 4 in 10^6 do not
SURE = 0.9999  # what is more probable is stated as more than this
_DIMENSIONS = 6  # these, and the difference of the sizes


@dataclass(frozen=True)
class PocketFit:
    """What has to fit.

    Attributes:
        cube, mouth: width of the cube and of the pocket at the plate's top, m.
        sigma: standard deviation of their difference, m.
    """

    cube: float
    mouth: float
    sigma: float


def insertion_probability(covariance: Array, fit: PocketFit, mean: Array | None = None) -> float:
    """Return the probability, 0 to 1.

    Args:
        covariance: of the cube's twist in the hole's frame, at the hole's origin, (6, 6).
        fit: sizes.
        mean: of that twist, (6,); default: zero.
    """
    index = [_X, _Y, _TURN_X, _TURN_Y, _YAW]
    if mean is None and _fits(_CERTAIN * np.sqrt(np.diag(covariance)[index]), fit, -_CERTAIN):
        return 1.0
    z = _normal_samples()
    errors = mul(_root(covariance[np.ix_(index, index)]), z[:5])
    if mean is not None:
        errors = errors + mean[index, None]
    return float(np.mean(_fits(errors, fit, z[5])))


def _fits(errors: Array, fit: PocketFit, wider: Array | float) -> Bools:
    """Whether cubes with errors (5, ...) in x, y, tilt and yaw enter pockets wider by so many standard deviations."""
    x, y, turn_x, turn_y, yaw = errors
    half = fit.cube / 2.0 * (np.abs(np.cos(yaw)) + np.abs(np.sin(yaw)))
    room = fit.mouth / 2.0 - half + fit.sigma / 2.0 * wider
    inside = np.maximum(np.abs(x), np.abs(y)) <= room
    return np.asarray(inside & (np.hypot(turn_x, turn_y) <= CAPTURE_TILT))


def percent(probability: float) -> str:
    """Return a probability in %, with no more digits than are known."""
    return f"> {100.0 * SURE:g}" if probability > SURE else f"{100.0 * probability:.2f}"


@lru_cache(maxsize=1)
def _normal_samples() -> Array:
    """Standard normal errors, (_DIMENSIONS, SAMPLES)."""
    ratio = 2.0
    for _ in range(60):  # the root of x^(n + 1) = x + 1, whose powers are hard to approximate by fractions
        ratio = (1.0 + ratio) ** (1.0 / (_DIMENSIONS + 1))
    steps = ratio ** -np.arange(1.0, _DIMENSIONS + 1.0)
    return frozen(ndtri((0.5 + np.arange(SAMPLES) * steps[:, None]) % 1.0))


def _root(covariance: Array) -> Array:
    """A matrix R with R R^T = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.clip(values, 0.0, None)))
