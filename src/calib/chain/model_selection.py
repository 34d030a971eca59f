"""Select the parts of a chain's model and reject wrong images, from the residuals.

Optional parts of a model (offsets of a head, joint compliance, backlash, link errors) are dropped one by one as long as
the cost rises no more than it would for meaningless unknowns (likelihood-ratio test, chi square). A model with a
superfluous part is more uncertain than necessary. A model that lacks a part is wrong, and nothing else shows it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import fdtri

from arm.se3 import Array
from calib.chain.fit import MOST_STEPS, ChainFit, Problem, Sightings, fit_chains
from calib.model.chi_square import chi2_limit, chi2_quantile

MEANINGLESS = 1e-3  # probability of keeping a part that is not there
WRONG_IMAGE = 1e-6  # probability of rejecting a correct image
_SOFT, _ROUNDS = 2.0, 12  # softness and rounds of the robust weights
_SECOND_CHANCES, _FAR = 10, 10.0  # rejected images to try again, at most so many times their limit
_SPOILT = 1.5  # chi2 per degree of freedom above which wrong images may have distorted the model


def largest_rise(chance: float, unknowns: int, noise_freedom: float) -> float:
    """Change of the cost that meaningless unknowns exceed with probability `chance`.

    It follows Fisher's F distribution, as the noise was estimated from `noise_freedom` measurements.
    """
    if np.isinf(noise_freedom):
        return float(chi2_limit(chance, unknowns))
    return unknowns * float(fdtri(unknowns, max(noise_freedom, 1.0), 1.0 - chance))


@dataclass(frozen=True)
class Part:
    """Unknowns that a model keeps or drops together.

    Attributes:
        name: in words.
        unknowns: their indices.
        known: whether they exist, by their prior, even if the images do not show them: without them in the model their
            effect is part of the covariance.
    """

    name: str
    unknowns: tuple[int, ...]
    known: bool = False


@dataclass(frozen=True)
class Trial:
    """A part dropped on trial.

    Attributes:
        part: its name.
        rise: of the cost without it.
        limit: largest insignificant rise.
        instead: the single cause that explains the images as well, and that `rise` includes; "" for none.
    """

    part: str
    rise: float
    limit: float
    instead: str = ""

    @property
    def needed(self) -> bool:
        """Whether the model keeps it."""
        return self.rise > self.limit and not self.instead


@dataclass(frozen=True, eq=False)
class Choice:
    """A selected model and its fit.

    Attributes:
        problem: with the selected unknowns free.
        fit: with weights 0 or 1.
        trials: the last trial of each part.
    """

    problem: Problem
    fit: ChainFit
    trials: tuple[Trial, ...]


def choose_model(problem: Problem, parts: Sequence[Part], weights: Sequence[Array] | None = None) -> Choice:
    """Fit with all parts, reject wrong images, then drop the parts that are not needed.

    Args:
        problem: with the unknowns of all parts free.
        parts: that may be dropped.
        weights: initial weights, 0 for images known to be wrong, (n,) of every chain.
    """
    fit = _without_wrong_images(problem, weights)
    if fit.chi2_dof > _SPOILT:  # wrong images distort a model with many unknowns, but not one with few
        begun = _without_wrong_images(without(problem, *parts), weights)
        other = _without_wrong_images(problem, begun.weights)
        fit = min(fit, other, key=lambda one: one.chi2_dof)
    return select_parts(problem, parts, fit, problem.noise_freedom)


def select_parts(problem: Problem, parts: Sequence[Part], fit: ChainFit, freedom: float) -> Choice:
    """Drop the parts that are not needed, the least needed first.

    Args:
        problem: with the unknowns of all parts free.
        parts: that may be dropped.
        fit: of the problem; its weights are kept.
        freedom: measurements that the sizes of all errors were estimated from; infinite if they are known.
    """
    kept = list(parts)
    trials: dict[str, Trial] = {}
    while kept:
        fits = {part.name: fit_chains(without(problem, part), fit.weights, fit) for part in kept}
        ranks: dict[str, tuple[bool, bool, float]] = {}
        for part in kept:
            limit = largest_rise(MEANINGLESS, len(part.unknowns), freedom)
            trials[part.name] = t = Trial(part.name, fits[part.name].cost - fit.cost, limit)
            # what exists anyway, by its prior, goes last: other parts may only stand in for it
            ranks[part.name] = t.needed, part.known, t.rise / t.limit
        least = min(kept, key=lambda part: ranks[part.name])
        if trials[least.name].needed:
            break
        problem, fit = without(problem, least), fits[least.name]
        kept.remove(least)
    return Choice(problem, fit, tuple(trials[part.name] for part in parts))


def without(problem: Problem, *parts: Part) -> Problem:
    """Return the problem without some parts."""
    free, start = problem.free.copy(), problem.start.copy()
    dropped = [i for part in parts for i in part.unknowns]
    free[dropped] = False
    start[dropped] = 0.0  # a dropped part is zero, whatever its prior mean
    return replace(problem, free=free, start=start)


def _without_wrong_images(problem: Problem, weights: Sequence[Array] | None) -> ChainFit:
    """Fit with robust weights first, then with weights 0 or 1."""
    fit = fit_chains(problem, weights)
    if fit.iterations >= MOST_STEPS:  # a fit that does not converge cannot judge images
        return fit
    now = list(fit.weights)
    for _ in range(_ROUNDS):
        off = _off(problem, fit)
        then = [1.0 / (1.0 + (_SOFT * np.maximum(o - 1.0, 0.0)) ** 2) for o in off]
        if max(float(np.abs(a - b).max()) for a, b in zip(then, now, strict=True)) < 0.02:
            break
        now = then
        fit = fit_chains(problem, now, fit)
    for _ in range(_ROUNDS):
        then = _within(problem, fit)
        if all(np.array_equal(a, b) for a, b in zip(then, fit.weights, strict=True)):
            break
        fit = fit_chains(problem, then, fit)
    return _taken_back(problem, fit)


def _taken_back(problem: Problem, fit: ChainFit) -> ChainFit:
    """Restore images that only seemed wrong: a few others predict an image badly, but with it all may agree."""
    limits = [_limit(s, problem.noise_freedom) for s in problem.sightings]
    left = [
        (float(off[i] / limit[i]), chain, int(i))
        for chain, (off, limit) in enumerate(zip(_off(problem, fit), limits, strict=True))
        for i in np.flatnonzero(fit.weights[chain] == 0.0)
    ]
    for off, chain, i in sorted(left)[:_SECOND_CHANCES]:
        if off > _FAR:
            break
        weights = [w.copy() for w in fit.weights]
        weights[chain][i] = 1.0
        trial = fit_chains(problem, weights, fit)
        used = (w > 0.0 for w in weights)
        if all(w[u].all() for w, u in zip(_within(problem, trial), used, strict=True)):
            fit = trial
    return fit


def _within(problem: Problem, fit: ChainFit) -> list[Array]:
    """1 for images with residuals within the limit, 0 for others."""
    off = _off(problem, fit)
    limits = [_limit(s, problem.noise_freedom) for s in problem.sightings]
    return [(o <= limit).astype(float) for o, limit in zip(off, limits, strict=True)]


def _off(problem: Problem, fit: ChainFit) -> list[Array]:
    """Rms residual of every image, relative to corner noise, or to the typical image if the model is incomplete."""
    sizes, used = [], []
    for s, r, w in zip(problem.sightings, fit.residuals, fit.weights, strict=True):
        size = np.sqrt(np.nanmean((r / s.sigma(problem.pixel_sigma)) ** 2, axis=(1, 2)))
        count = np.isfinite(s.pixels).sum(axis=(1, 2))
        sizes.append(size)
        used.append((size * np.sqrt(count / chi2_quantile(0.5, count)))[w > 0.0])
    typical = max(1.0, float(np.median(np.concatenate(used))))
    return [size / typical for size in sizes]


def _limit(s: Sightings, noise_freedom: float) -> Array:
    """Largest rms of a correct image, (n,)."""
    count = np.isfinite(s.pixels).sum(axis=(1, 2))
    by_count = {c: np.sqrt(largest_rise(WRONG_IMAGE, int(c), noise_freedom) / c) for c in np.unique(count)}
    return np.array([by_count[c] for c in count])
