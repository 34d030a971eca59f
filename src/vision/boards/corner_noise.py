"""Variance of a board's mean corners: noise of each frame, and an error common to all frames.

Frames differ only by their own noise, but the residuals of a fit contain both parts. So the common part is estimated.
The variance includes the uncertainty of this estimate, which has only ten degrees of freedom.
"""

from __future__ import annotations

import numpy as np

from arm.se3 import Array
from vision.boards.pose_fit import Corners, Fit, frame_variance
from vision.boards.shared_errors import LeftOver

SPIKE, SLAB = 0.5, 4.0  # probability and relative width in the prior, see `mean_corner_variance`
_GRID = 240


def mean_corner_variance(corners: Corners, fit: Fit, floor_px: float, left: LeftOver | None = None) -> float:
    """Return the variance of a mean corner's coordinate, px^2, as expected after the fit.

    It is the posterior mean of c^2 + f^2 / frames, with f from the scatter between frames and the common part c from
    the residuals of the fit. In the prior, c is the floor with probability `SPIKE`, else above it with a half-Cauchy
    distribution (A. Gelman, "Prior distributions for variance parameters", 2006), `SLAB` times as wide as the frames'
    own part. With one frame the parts cannot be separated, and only the residuals count.

    Args:
        corners: the fitted corners.
        fit: their fit.
        floor_px: smallest standard deviation of the common error.
        left: residuals relative to errors that corners share; None if there are no such errors.
    """
    nu, cost = fit.freedom, fit.cost
    alone = cost / max(nu - 2, 1)  # mean of the variance under Jeffreys' prior
    of_frames = frame_variance(corners, fit)
    if of_frames is None:
        return max(alone if left is None else _of_one_frame(left, floor_px), floor_px**2)
    of_mean = of_frames / fit.frames
    width = SLAB * max(floor_px, float(np.sqrt(of_mean)))
    top = 30.0 * max(width, float(np.sqrt(alone)))
    beyond = np.concatenate([[0.0], np.geomspace(1e-3 * width, top, _GRID)])  # px above the floor
    variance = (floor_px + beyond) ** 2 + of_mean
    log_likelihood = -0.5 * nu * np.log(variance) - 0.5 * cost / variance
    if left is not None:
        log_likelihood = left.log_likelihood(variance)
    likelihood = np.exp(log_likelihood - log_likelihood.max())
    slab = likelihood * (1.0 - SPIKE) * 2.0 / (np.pi * width * (1.0 + (beyond / width) ** 2))
    spike = likelihood[0] * SPIKE
    total = np.trapezoid(slab, beyond) + spike
    return float((np.trapezoid(slab * variance, beyond) + spike * variance[0]) / total)


def _of_one_frame(left: LeftOver, floor_px: float) -> float:
    """Posterior mean of the variance, px^2, under Jeffreys' prior above the floor."""
    top = 10.0 * float(left.squares.max())
    variance: Array = np.geomspace(floor_px**2, max(top, 4.0 * floor_px**2), _GRID)
    log_likelihood = left.log_likelihood(variance)
    posterior = np.exp(log_likelihood - log_likelihood.max())  # per logarithm of the variance
    return float((posterior * variance).sum() / posterior.sum())
