"""Self-test by a parametric bootstrap: redraw the images of the user's data from the solution, and solve again.

The truth of the redrawn data (twins) is known, so the predicted errors can be checked. If they are right, the poses
determine the unknowns and the solver is sound. The test does not show errors of the model; chi2 does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.se3 import Array
from calib.chain.fit import Problem, Sightings, fit_chains
from calib.chain.result import ChainCalibration
from calib.model.chi_square import chi2_quantile

TWINS = 4
BY_CHANCE = 1e-3  # probability that a sound calibration fails


@dataclass(frozen=True)
class SelfTest:
    """Result of the self-test.

    Attributes:
        nees_dof: normalised estimation error squared per unknown; about 1.
        limits: on `nees_dof`.
        worst: largest error of an unknown, in predicted standard deviations.
    """

    nees_dof: float
    limits: tuple[float, float]
    worst: float

    @property
    def passed(self) -> bool:
        """Whether the errors are as predicted."""
        return self.limits[0] <= self.nees_dof <= self.limits[1]


def self_test(c: ChainCalibration, twins: int = TWINS, seed: int = 0) -> SelfTest:
    """Redraw the images of a calibration `twins` times, and solve each with the selected model.

    Args:
        c: the calibration.
        twins: number of redrawn data sets.
        seed: of their noise.
    """
    free = np.flatnonzero(c.problem.free)
    rng = np.random.default_rng(seed)
    squares, worst = 0.0, 0.0
    for _ in range(twins):
        # unknowns with a prior deviate from its mean as the prior predicts
        known = np.isfinite(c.problem.prior_sigma) & c.problem.free
        shift = rng.normal(size=len(known)) * np.where(known, c.problem.prior_sigma, 0.0)
        start = np.where(known, c.fit.unknowns - shift, c.problem.start)
        sightings = [_twin(c.problem, s, c.fit.unknowns, rng) for s in c.problem.sightings]
        problem = replace(c.problem, sightings=sightings, start=start)
        fit = fit_chains(problem, c.fit.weights)
        off = (fit.unknowns - c.fit.unknowns)[free]
        squares += float(off @ fit.information @ off)
        sigma = np.sqrt(np.diag(fit.covariance(problem.free)))[free]
        worst = max(worst, float(np.abs(off / sigma).max()))
    count = twins * len(free)
    low, high = chi2_quantile([BY_CHANCE / 2.0, 1.0 - BY_CHANCE / 2.0], count) / count
    return SelfTest(squares / count, (float(low), float(high)), worst)


def _twin(problem: Problem, s: Sightings, unknowns: Array, rng: np.random.Generator) -> Sightings:
    """Return the same images with corners and readings redrawn about the solution."""
    errors = np.zeros_like(s.readings)
    for j, sigma in enumerate(problem.reading_sigma):
        if sigma > 0.0:
            _, back = np.unique(s.reading_ids[:, j], return_inverse=True)
            errors[:, j] = rng.normal(0.0, sigma, back.max() + 1)[back]
    exact = s.predicted(problem.camera, unknowns, errors)
    drawn = exact + rng.normal(size=s.pixels.shape) * s.sigma(problem.pixel_sigma)
    return replace(s, pixels=np.where(np.isfinite(s.pixels), drawn, np.nan))
