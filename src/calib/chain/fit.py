"""Fit the unknowns of kinematic chains to images of targets at their ends: least squares with errors in the readings.

Every reading of an inexact encoder gets an error of its own. Its prior has the encoder's standard deviation, and all
images taken at that reading share it. These errors are eliminated stance by stance (Schur complement), as the poses are
in `calib.camera.bundle_adjustment`. To first order this equals weighting the pixels by their full covariance
(generalised least squares), so a coarse encoder is not treated as exact (docs/sources.md, "Encoder errors").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, Bools, Indices
from calib.model.chain import Chain, Evaluated
from calib.model.least_squares import (
    Eliminated,
    Step,
    eliminate,
    embedded,
    inverse_scaled,
    levenberg_marquardt,
    solve_scaled,
)
from vision.camera.model import Camera
from vision.camera.projection import Projection, along

MOST_STEPS = 60
_STEP_DONE = 1e-3  # stop once every step is below a thousandth of its standard deviation

_State = tuple[Array, list[Array]]  # unknowns, and errors of the readings of every chain
Gains = Callable[[Array, Array], dict[str, Array]]
"""Gains of unknowns by name, each (n,), from readings (n, readings) and unknowns (count,)."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """Images of a target at the end of one chain.

    Attributes:
        chain: T_camera_target.
        readings: (n, readings) rad or m at each image.
        reading_ids: (n, readings); images with the same number in a column share that reading and its error.
        stances: (n,); images with the same number are eliminated together, and only these may share readings.
        points: (m, 3) m in the target frame.
        pixels: (n, m, 2) px, NaN where a point was not detected.
        gains: of unknowns, or None.
        noise: of each image's corners, relative to a typical image, (n,); None for 1.
        effects: change of the projected points by the last k unknowns, which act on the image and not on the chain,
            (n, m, 2, k) px; None for no such unknowns.
    """

    chain: Chain
    readings: Array
    reading_ids: Indices
    stances: Indices
    points: Array
    pixels: Array
    gains: Gains | None = None
    noise: Array | None = None
    effects: Array | None = None

    def sigma(self, pixel_sigma: Array) -> Array:
        """Standard deviations of every image's corners, (n, 1, 2) px, from those of a typical image (2,)."""
        noise = np.ones(len(self.readings)) if self.noise is None else self.noise
        return np.asarray(noise[:, None, None] * pixel_sigma)

    def evaluate(self, unknowns: Array, errors: Array | float = 0.0) -> Evaluated:
        """Evaluate the chain for unknowns (count,), with errors (n, readings) added to the readings."""
        corrected = self.readings + errors
        gains = self.gains(corrected, unknowns) if self.gains is not None else None
        return self.chain.evaluate(corrected, unknowns, gains)

    def projection(self, camera: Camera, unknowns: Array, errors: Array | float = 0.0) -> Projection:
        """Project the target's points at every image, without `effects`; `errors` are added to the readings."""
        return Projection(camera, self.evaluate(unknowns, errors).T, self.points)

    def predicted(self, camera: Camera, unknowns: Array, errors: Array | float = 0.0) -> Array:
        """Pixels of the target's points at every image, (n, m, 2); `errors` are added to the readings."""
        return self.projection(camera, unknowns, errors).pixels + self.shifts(unknowns)

    def shifts(self, unknowns: Array) -> Array | float:
        """Change of the projected points by the unknowns that act on the image, (n, m, 2) px, or 0."""
        if self.effects is None:
            return 0.0
        return np.asarray(self.effects @ unknowns[len(unknowns) - self.effects.shape[-1] :])

    def jacobian(self, by_target: Array, by_unknown: Array, scale: Array) -> Array:
        """Derivatives of the points by all unknowns, (n, m, 2, count), from those by the target's twist.

        Args:
            by_target: (n, m, 2, 6), multiplied by `scale`; 0 for points that were not detected.
            by_unknown: twists (n, count, 6).
            scale: of each point, (n, m or 1, 2).
        """
        J = along(by_target, by_unknown)
        if self.effects is not None:
            detected = np.isfinite(self.pixels)
            J[..., J.shape[-1] - self.effects.shape[-1] :] += np.where(
                detected[..., None], self.effects * scale[..., None], 0.0
            )
        return J


@dataclass(frozen=True, eq=False)
class Problem:
    """An estimation problem.

    Attributes:
        sightings: of every chain.
        camera: intrinsics; at the origin.
        start: of the unknowns, (count,); also the mean of their prior.
        prior_sigma: standard deviation of the unknowns' prior, (count,); infinite without a prior.
        pixel_sigma: standard deviation of a corner's x and y, (2,) px.
        reading_sigma: standard deviation of the readings, (readings,) rad or m; 0 for exact ones.
        free: which unknowns are fitted, (count,).
        noise_freedom: measurements that `pixel_sigma` was estimated from; infinite if it is known.
    """

    sightings: Sequence[Sightings]
    camera: Camera
    start: Array
    prior_sigma: Array
    pixel_sigma: Array
    reading_sigma: Array
    free: Bools
    noise_freedom: float = np.inf


@dataclass(frozen=True, eq=False)
class ChainFit:
    """Fitted unknowns.

    Attributes:
        unknowns: (count,).
        errors: of the readings of every chain, (n, readings) each.
        residuals: reprojection error, measured minus projected, (n, m, 2) px of every chain; NaN if not detected.
        cost: minimised sum of squares over their variances.
        information: (free, free) of the free unknowns, including the priors.
        iterations: number of steps.
        freedom: measurements minus unknowns; a reading's error adds one of each, because its prior is a measurement.
        weights: of every image of every chain, (n,) each.
    """

    unknowns: Array
    errors: tuple[Array, ...]
    residuals: tuple[Array, ...]
    cost: float
    information: Array
    iterations: int
    freedom: int
    weights: tuple[Array, ...] = ()

    @property
    def chi2_dof(self) -> float:
        """Cost per degree of freedom, about 1 if the model is complete and the standard deviations are right."""
        return self.cost / max(self.freedom, 1)

    @property
    def wrong(self) -> tuple[Indices, ...]:
        """Images of weight 0 of every chain."""
        return tuple(np.flatnonzero(w == 0.0) for w in self.weights)

    @property
    def own(self) -> int:
        """Degrees of freedom if every used image had a pose of its own, so that its residuals were noise alone."""
        images = zip(self.residuals, self.weights, strict=True)
        measured = [np.isfinite(r[w > 0.0]).sum(axis=(1, 2)) for r, w in images]
        return int(np.maximum(np.concatenate(measured) - 6, 0).sum())

    def excess(self, noise_freedom: float, drop: float = 0.0, unknowns: int = 0) -> float:
        """Cost per degree of freedom between images, about 1 if the model is complete.

        If the noise was estimated from the images, each degree of freedom within an image costs 1, and the chain causes
        the rest of the cost. `chi2_dof` hardly shows that rest if there are many corners per image.

        Args:
            noise_freedom: measurements that the noise was estimated from; infinite if it was known (then all count).
            drop: decrease of the cost by further unknowns.
            unknowns: number of further unknowns.
        """
        own = self.own if np.isfinite(noise_freedom) else 0
        return (self.cost - drop - own) / max(self.freedom - unknowns - own, 1)

    def covariance(self, free: Bools) -> Array:
        """Covariance of all unknowns, (count, count); zero rows for those held."""
        return embedded(inverse_scaled(self.information), free)


def fit_chains(
    problem: Problem, weights: Sequence[Array] | None = None, begin: ChainFit | None = None
) -> ChainFit:
    """Fit by Levenberg-Marquardt.

    Args:
        problem: with its start.
        weights: of every image of every chain, (n,) each; default: 1. Images of weight 0 are ignored.
        begin: another fit to start from.
    """
    weights = [np.ones(len(s.readings)) for s in problem.sightings] if weights is None else list(weights)
    x = problem.start.copy()
    errors = [np.zeros_like(s.readings) for s in problem.sightings]
    if begin is not None:
        x[problem.free] = begin.unknowns[problem.free]
        errors = [e.copy() for e in begin.errors]

    shares = [_share(s, w) for s, w in zip(problem.sightings, weights, strict=True)]

    def linearise(at: _State) -> Step[_State]:
        S, g, stances = _system(problem, *at, weights)

        def step(damping: float) -> tuple[_State, bool]:
            change = solve_scaled(S + damping * np.diag(np.diag(S)), g)
            x, errors = at[0].copy(), [e.copy() for e in at[1]]
            x[problem.free] += change
            for stance in stances:
                values = stance.equations.alone - stance.equations.by_kept @ change
                for value, (j, shared) in zip(values, stance.columns, strict=True):
                    errors[stance.chain][shared, j] += value
            close = np.abs(change * np.sqrt(np.diag(S))).max(initial=0.0) < _STEP_DONE
            return (x, errors), bool(close)

        return step

    (x, errors), iterations = levenberg_marquardt(
        (x, errors), lambda at: _cost(problem, *at, weights, shares), linearise, MOST_STEPS
    )
    residuals = tuple(
        s.pixels - s.predicted(problem.camera, x, e) for s, e in zip(problem.sightings, errors, strict=True)
    )
    measured = sum(int(np.isfinite(r[w > 0.0]).sum()) for r, w in zip(residuals, weights, strict=True))
    priors = int(np.isfinite(problem.prior_sigma[problem.free]).sum())
    return ChainFit(
        x,
        tuple(errors),
        residuals,
        _cost(problem, x, errors, weights, shares),
        _system(problem, x, errors, weights)[0],
        iterations,
        measured - int(problem.free.sum()) + priors,
        tuple(weights),
    )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of each stance for the free unknowns and k further ones, with reading errors eliminated.

    Attributes:
        prior: information and gradient of the priors, (free + k, free + k) and (free + k,).
        S: information of each stance in the order of chains and stances, (stances, free + k, free + k).
        g: negative gradients of the cost, (stances, free + k).
    """

    prior: tuple[Array, Array]
    S: Array
    g: Array

    @property
    def total(self) -> tuple[Array, Array]:
        """Information and gradient of all stances together, with the priors."""
        return self.prior[0] + self.S.sum(axis=0), self.prior[1] + self.g.sum(axis=0)


def normal_equations(
    problem: Problem, fit: ChainFit, extra: Sequence[Array] | None = None
) -> NormalEquations:
    """Return the normal equations at a fit.

    Args:
        problem: of the fit.
        fit: where to linearise.
        extra: derivatives of the projected points by further unknowns, (n, m, 2, k) px of every chain.
    """
    prior = _priors(problem, fit.unknowns, 0 if extra is None else extra[0].shape[-1])
    each = [s.equations for s in _stances(problem, fit.unknowns, fit.errors, fit.weights, extra)]
    return NormalEquations(prior, np.array([e.S for e in each]), np.array([e.g for e in each]))


def _cost(
    problem: Problem, x: Array, errors: Sequence[Array], weights: Sequence[Array], shares: Sequence[Array]
) -> float:
    off = (x - problem.start) / problem.prior_sigma
    total = float((off**2).sum())
    exact = problem.reading_sigma <= 0.0
    for s, e, w, share in zip(problem.sightings, errors, weights, shares, strict=True):
        r = s.pixels - s.predicted(problem.camera, x, e)
        if not np.array_equal(np.isfinite(r), np.isfinite(s.pixels)):
            return float("inf")  # a point behind the camera
        total += float(np.nansum(w[:, None, None] * (r / s.sigma(problem.pixel_sigma)) ** 2))
        total += float(((e[:, ~exact] / problem.reading_sigma[~exact]) ** 2 * share[:, ~exact]).sum())
    return total


def _share(s: Sightings, weights: Array) -> Array:
    """One over the number of used images that share a reading, (n, readings), so that each error counts once."""
    used = weights > 0.0
    share = np.zeros(s.reading_ids.shape)
    for j, column in enumerate(s.reading_ids.T):
        _, back, count = np.unique(column[used], return_inverse=True, return_counts=True)
        share[used, j] = 1.0 / count[back]
    return share


@dataclass(frozen=True, eq=False)
class _Stance:
    """Normal equations of the free unknowns from a stance, with its reading errors eliminated."""

    chain: int
    columns: list[tuple[int, Indices]]  # of each error: reading, and the images sharing it
    equations: Eliminated


def _system(
    problem: Problem, x: Array, errors: Sequence[Array], weights: Sequence[Array]
) -> tuple[Array, Array, list[_Stance]]:
    """Information and negative gradient of the free unknowns with all errors eliminated, and their stances."""
    S, g = _priors(problem, x)
    stances = list(_stances(problem, x, errors, weights, apart=False))
    for stance in stances:
        S += stance.equations.S
        g += stance.equations.g
    return S, g, stances


def _priors(problem: Problem, x: Array, more: int = 0) -> tuple[Array, Array]:
    weight = np.append(problem.prior_sigma[problem.free] ** -2, np.zeros(more))
    return np.diag(weight), weight * np.append((problem.start - x)[problem.free], np.zeros(more))


def _stances(
    problem: Problem,
    x: Array,
    errors: Sequence[Array],
    weights: Sequence[Array],
    extra: Sequence[Array] | None = None,
    apart: bool = True,
) -> Iterator[_Stance]:
    """Yield every used stance of every chain; unless `apart`, merge the stances if no reading has an error."""
    inexact = np.flatnonzero(problem.reading_sigma > 0.0)
    for chain, (s, e, w) in enumerate(zip(problem.sightings, errors, weights, strict=True)):
        at = s.evaluate(x, e)
        r, by_target, scale = whitened(problem, s, at, w, x)
        J = s.jacobian(by_target, at.by_unknown, scale)[..., problem.free]
        if extra is not None:
            detected = np.isfinite(s.pixels)[..., None]
            J = np.concatenate([J, np.where(detected, extra[chain] * scale[..., None], 0.0)], axis=-1)
        by_reading = along(by_target, at.by_reading) if len(inexact) else np.zeros((*r.shape, 0))
        stances = s.stances if apart or len(inexact) else np.zeros_like(s.stances)
        for stance in np.unique(stances[w > 0.0]):
            together = np.flatnonzero(stances == stance)
            images = together[w[together] > 0.0]
            rows = r[images].reshape(-1)
            A = J[images].reshape(len(rows), -1)
            columns = [
                (int(j), together[s.reading_ids[together, j] == i])
                for j in inexact
                for i in sorted(set(s.reading_ids[images, j].tolist()))
            ]
            N = np.zeros((*r[images].shape, len(columns)))
            for k, (j, shared) in enumerate(columns):
                of = s.reading_ids[images, j] == s.reading_ids[shared[0], j]
                N[of, ..., k] = by_reading[images[of], ..., j]
            sigma = problem.reading_sigma[[j for j, _ in columns]]
            now = np.array([e[shared[0], j] for j, shared in columns])
            prior = np.diag(sigma**-2), -now / sigma**2
            yield _Stance(chain, columns, eliminate(A, N.reshape(len(rows), -1), rows, *prior))


def whitened(
    problem: Problem, s: Sightings, at: Evaluated, weights: Array, x: Array
) -> tuple[Array, Array, Array]:
    """Residuals (n, m, 2), derivatives of the points by the target's twist (n, m, 2, 6), 0 if missing; and their scale.

    The scale (n, m or 1, 2) is that by which both were multiplied.
    """
    projection = Projection(problem.camera, at.T, s.points)
    r = s.pixels - projection.pixels - s.shifts(x)
    scale = np.sqrt(weights)[:, None, None] / s.sigma(problem.pixel_sigma)
    measured = np.isfinite(r)
    by_target = np.where(measured[..., None], projection.by_target * scale[..., None], 0.0)
    return np.where(measured, r * scale, 0.0), by_target, scale
