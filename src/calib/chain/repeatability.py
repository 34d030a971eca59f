"""Fit an arm that scatters: estimate the sizes of its errors, its wrong images and the parts of its model together.

A chain whose images disagree by more than corners explain has either a fault or an arm that does not repeat. A fault is
one cause that explains the disagreement. The rest is scatter, which the fit then expects of every reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array
from calib.chain.fit import ChainFit, Problem, fit_chains
from calib.chain.model_selection import WRONG_IMAGE, Choice, Part, largest_rise, select_parts
from calib.chain.scatter import Sizes, estimate_sizes, reduced

_ROUNDS = 4  # of sizes, wrong images and fit


@dataclass(frozen=True, eq=False)
class Scattering:
    """A choice of the model of an arm that scatters.

    Attributes:
        choice: problem, fit and trials; the readings' standard deviations include the scatter.
        base: standard deviations of the readings without it, (readings,) rad.
        smooth: indices of the unknowns that are smooth errors.
        sizes: of scatter and smooth errors.
        freedom: measurements that the sizes were estimated from.
    """

    choice: Choice
    base: Array
    smooth: tuple[int, ...]
    sizes: Sizes
    freedom: float


def fit_scattering(
    problem: Problem, parts: Sequence[Part], start: ChainFit, smooth: Sequence[int]
) -> Scattering:
    """Estimate the scatter of an arm, with all else that is unknown.

    Args:
        problem: of a single chain, with the unknowns of all parts free, and those of the smooth errors held.
        parts: of the model that may be dropped.
        start: a fit, with weight 0 for images that seem wrong.
        smooth: indices of the unknowns that are smooth errors; may be empty.
    """
    base = problem.reading_sigma
    everything = np.arange(len(problem.sightings[0].readings))
    fit = start
    data = reduced(problem, fit, base, smooth, images=everything)
    sizes = estimate_sizes(data, robust=True)
    for _ in range(_ROUNDS):
        free = int(problem.free.sum())
        weights, freedom = _kept(sizes, len(everything), free)
        expected = _expecting(problem, base, smooth, sizes)
        fit = fit_chains(expected, [weights], fit)
        data = reduced(problem, fit, base, smooth, images=everything)
        before, sizes = sizes, estimate_sizes(data, weights, sizes)
        still = np.abs(np.log(sizes.scatter / before.scatter)).max() < 0.05
        if still and np.array_equal(_kept(sizes, len(everything), free)[0], weights):
            break
    expected = _expecting(problem, base, smooth, sizes)
    choice = select_parts(expected, parts, fit_chains(expected, [weights], fit), freedom)
    dropped = replace(problem, free=choice.problem.free & problem.free, start=choice.problem.start)
    sizes = estimate_sizes(reduced(dropped, choice.fit, base, smooth), begin=sizes)
    expected = _expecting(dropped, base, smooth, sizes)
    choice = Choice(expected, fit_chains(expected, [weights], choice.fit), choice.trials)
    return Scattering(choice, base, tuple(smooth), sizes, freedom)


def _expecting(problem: Problem, base: Array, smooth: Sequence[int], sizes: Sizes) -> Problem:
    """The problem with errors of these sizes."""
    free, prior = problem.free.copy(), problem.prior_sigma.copy()
    if sizes.smooth:
        free[list(smooth)], prior[list(smooth)] = True, sizes.smooth
    return replace(problem, reading_sigma=np.hypot(base, sizes.scatter), free=free, prior_sigma=prior)


def _kept(sizes: Sizes, images: int, unknowns: int) -> tuple[Array, float]:
    """Weights of the images, 1 or 0, and the degrees of freedom of the sizes."""
    freedom = max(6.0 * images - unknowns, 6.0)
    return (sizes.distances <= largest_rise(WRONG_IMAGE, 6, freedom)).astype(float), freedom
