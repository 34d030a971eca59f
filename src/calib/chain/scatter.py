"""Scatter of an arm: the sizes of the errors in its readings, estimated from images by restricted maximum likelihood.

An arm that does not repeat comes to rest beside its reading, by an error of its own at every pose. Gears that run out
of true and links that sag add errors that vary smoothly with the pose. Neither is a fault, and no image determines them
one by one, but how far the images disagree shows their sizes (variance components, as in `calib.robot_world.reml`).

Every image is reduced to the six degrees of freedom of its target's pose, which is all that it says about the arm. For
given sizes the unknowns follow in closed form, so the likelihood with all of them integrated out costs milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize

from arm.se3 import Array, Indices
from calib.chain.fit import ChainFit, NormalEquations, Problem, whitened
from calib.model.least_squares import inverse_scaled

TYPICAL = np.radians(0.005)  # rad; typical size of a joint's scatter, and of its smooth errors
# Standard deviations of the logarithm of the common size, and of each joint's about it.
_WIDE, _SPREAD = 2.0, 0.7
_SMOOTH_SPREAD = 1.0  # the same of the smooth errors' size
_SIZES = (np.log(1e-7), np.log(0.02))  # rad
_HEAVY = 4.0  # degrees of freedom of Student's t, for weights that tolerate wrong images
_REWEIGHTED = 6


@dataclass(frozen=True, eq=False)
class Reduced:
    """Images of one chain, reduced to poses of the target, linearised at a fit; n images, k unknowns.

    Attributes:
        images: their numbers, (n,).
        y: whitened errors of the measured poses, (n, 6).
        F: their derivatives by the free unknowns with the smooth errors among them, then further unknowns, (n, 6, k).
        M: by the readings, (n, 6, readings).
        precision: of the unknowns' priors, (k,); 0 without one. That of the smooth errors is not known: 0.
        gap: mean of the priors minus the present values, (k,).
        base: known standard deviations of the readings, (readings,) rad.
        smooth: where the smooth errors are among the k.
    """

    images: Indices
    y: Array
    F: Array
    M: Array
    precision: Array
    gap: Array
    base: Array
    smooth: Indices


@dataclass(frozen=True, eq=False)
class Sizes:
    """Estimated sizes.

    Attributes:
        scatter: standard deviation of each reading's error, (readings,) rad.
        smooth: standard deviation of the coefficients of the smooth errors, rad; 0 if there are none.
        distances: squared Mahalanobis distances of the images, (n,); about 6 each.
    """

    scatter: Array
    smooth: float
    distances: Array


def reduced(
    problem: Problem,
    fit: ChainFit,
    base: Array,
    smooth: Sequence[int] = (),
    extra: Array | None = None,
    images: Indices | None = None,
) -> Reduced:
    """Reduce the images of the first chain.

    Args:
        problem: of the fit.
        fit: where to linearise.
        base: known standard deviations of the readings, (readings,) rad.
        smooth: indices of the unknowns that are smooth errors.
        extra: derivatives of the projected points by further unknowns, (n, m, 2, e) px.
        images: to use; default: those with a weight.
    """
    s, x = problem.sightings[0], fit.unknowns
    at = s.evaluate(x)
    r, by_target, scale = whitened(problem, s, at, np.ones(len(s.readings)), x)
    used = np.flatnonzero(fit.weights[0] > 0.0) if images is None else images
    Q, R = np.linalg.qr(by_target[used].reshape(len(used), -1, 6))
    order = np.union1d(np.flatnonzero(problem.free), np.asarray(smooth, dtype=np.intp)).astype(np.intp)
    waves = np.flatnonzero(np.isin(order, np.asarray(smooth, dtype=np.intp)))
    J = s.jacobian(by_target, at.by_unknown, scale)[..., order][used]
    if extra is not None:
        detected = np.isfinite(s.pixels)[..., None]
        J = np.concatenate([J, np.where(detected, extra * scale[..., None], 0.0)[used]], axis=-1)
    rows = J.reshape(len(used), -1, J.shape[-1])
    further = J.shape[-1] - len(order)
    precision = problem.prior_sigma[order] ** -2.0
    precision[waves] = 0.0
    gap = (problem.start - x)[order]
    return Reduced(
        used,
        np.einsum("nri,nr->ni", Q, r[used].reshape(len(used), -1)),
        np.swapaxes(Q, 1, 2) @ rows,
        R @ np.swapaxes(at.by_reading[used], 1, 2),
        np.append(precision, np.zeros(further)),
        np.append(gap, np.zeros(further)),
        base,
        waves,
    )


def estimate_sizes(
    data: Reduced, weights: Array | None = None, begin: Sizes | None = None, robust: bool = False
) -> Sizes:
    """Estimate the sizes by restricted maximum likelihood.

    Args:
        data: images.
        weights: of the images, (n,); default: 1. Images of weight 0 are ignored, but have a distance.
        begin: sizes to start from.
        robust: give images that disagree less weight, so that wrong ones do not pass for scatter.
    """
    readings = data.M.shape[2]
    theta = np.full(readings + 1, np.log(TYPICAL))
    if begin is not None:
        theta = np.clip(np.log(np.append(begin.scatter, begin.smooth or TYPICAL)), *_SIZES)
    weights = np.ones(len(data.y)) if weights is None else weights
    for _ in range(_REWEIGHTED if robust else 1):
        found = minimize(
            lambda at, w=weights: _Likelihood(data, at, w).value_and_gradient,
            theta,
            jac=True,
            method="L-BFGS-B",
            bounds=[_SIZES] * len(theta),
            options={"maxiter": 40, "ftol": 1e-7},
        )
        theta = np.asarray(found.x)
        solved = _Likelihood(data, theta, weights)
        if robust:
            weights = (_HEAVY + 6.0) / (_HEAVY + solved.distances)
    sizes = np.exp(theta)
    return Sizes(sizes[:-1], float(sizes[-1]) if len(data.smooth) else 0.0, solved.distances)


def equations_of(data: Reduced, sizes: Sizes) -> NormalEquations:
    """Normal equations of each image for the k unknowns, with the readings' errors integrated out."""
    W = _information(data, sizes.scatter)
    precision = data.precision.copy()
    if sizes.smooth:
        precision[data.smooth] = sizes.smooth**-2.0
    WF = W @ data.F
    return NormalEquations(
        (np.diag(precision), precision * data.gap),
        np.swapaxes(data.F, 1, 2) @ WF,
        np.einsum("nik,ni->nk", WF, data.y),
    )


def _information(data: Reduced, scatter: Array) -> Array:
    variances = data.base**2 + scatter**2
    return np.asarray(np.linalg.inv(np.eye(6) + (data.M * variances) @ np.swapaxes(data.M, 1, 2)))


class _Likelihood:
    """Negative log likelihood of sizes, with weak priors, and its gradient."""

    def __init__(self, data: Reduced, theta: Array, weights: Array) -> None:
        scatter, tau = np.exp(theta[:-1]), float(np.exp(theta[-1]))
        F, M, y, smooth = data.F, data.M, data.y, data.smooth
        count = len(smooth)
        precision = data.precision.copy()
        precision[smooth] = tau**-2.0
        V1 = _information(data, scatter)
        V1F = V1 @ F
        wVF = weights[:, None, None] * V1F
        k = F.shape[2]
        S = np.diag(precision) + F.reshape(-1, k).T @ wVF.reshape(-1, k)
        g = precision * data.gap + np.einsum("nik,ni->k", wVF, y)
        inverse = inverse_scaled(S)
        step = inverse @ g
        left = y - F @ step
        V1left = np.einsum("nij,nj->ni", V1, left)
        self.distances: Array = np.einsum("ni,ni->n", left, V1left)
        off = step - data.gap
        diagonal = np.diag(S)
        scaled = S / np.sqrt(np.outer(diagonal, diagonal))
        used = (weights > 0.0).astype(float)
        value = -0.5 * float(np.linalg.slogdet(V1)[1] @ used)
        value += 0.5 * float(np.linalg.slogdet(scaled)[1] + np.log(diagonal).sum()) + count * theta[-1]
        value += 0.5 * float(weights @ self.distances + precision @ off**2)
        MV = np.swapaxes(M, 1, 2) @ V1
        B = MV @ F
        alone = np.einsum("nji,nij->nj", MV, M)
        known = ((B.reshape(-1, k) @ inverse).reshape(B.shape) * B).sum(axis=2)
        fits = np.einsum("nij,ni->nj", M, V1left) ** 2
        gradient = scatter**2 * (used[:, None] * alone - weights[:, None] * (known + fits)).sum(axis=0)
        by_tau = count - tau**-2.0 * (np.diag(inverse)[smooth].sum() + (off[smooth] ** 2).sum())
        slope = np.append(gradient, by_tau)
        common = theta[:-1].mean()
        apart = theta[:-1] - common
        about = (common - np.log(TYPICAL)) / _WIDE
        of_smooth = (theta[-1] - np.log(TYPICAL)) / _SMOOTH_SPREAD
        value += 0.5 * float((apart**2).sum() / _SPREAD**2 + about**2 + of_smooth**2)
        slope[:-1] += apart / _SPREAD**2 + about / (_WIDE * len(apart))
        slope[-1] += of_smooth / _SMOOTH_SPREAD
        self.value_and_gradient: tuple[float, Array] = value, slope
