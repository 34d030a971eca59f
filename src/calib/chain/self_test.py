"""A self-test on a synthetic twin of a user's own data: the same images drawn from what was found, and solved again.

What the solver says of its errors can be checked there, because the truth is known. A twin that comes out as predicted
says that poses, numbers and solver are sound; it says nothing of what the model lacks (that is what chi2 is for).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from arm.se3 import Array
from calib.chain.fit import Problem, Sightings, fit_chains
from calib.chain.result import ChainCalibration

TWINS = 4
BY_CHANCE = 1e-3  # how often a sound calibration fails the test


@dataclass(frozen=True)
class SelfTest:
    """What became of the twins.

    Attributes:
        nees_dof: squares of the errors over their predicted covariance, per unknown; about 1.
        limits: between which chance leaves it.
        worst: largest error of an unknown, in its predicted standard deviations.
    """

    nees_dof: float
    limits: tuple[float, float]
    worst: float

    @property
    def passed(self) -> bool:
        """Whether errors are as predicted."""
        return self.limits[0] <= self.nees_dof <= self.limits[1]


def self_test(c: ChainCalibration, twins: int = TWINS, seed: int = 0) -> SelfTest:
    """Draw twins of a calibration's images and solve them with the model that was chosen.

    Args:
        c: the calibration.
        twins: how many.
        seed: of their noise.
    """
    free = np.flatnonzero(c.problem.free)
    rng = np.random.default_rng(seed)
    squares, worst = 0.0, 0.0
    for _ in range(twins):
        # unknowns with a prior differ from its mean by chance, as the prior says
        known = np.isfinite(c.problem.prior_sigma) & c.problem.free
        shift = np.where(
            known, rng.normal(size=len(known)) * np.where(known, c.problem.prior_sigma, 0.0), 0.0
        )
        start = np.where(known, c.fit.unknowns - shift, c.problem.start)
        sightings = [_twin(c.problem, s, c.fit.unknowns, rng) for s in c.problem.sightings]
        problem = replace(c.problem, sightings=sightings, start=start)
        fit = fit_chains(problem, c.fit.weights)
        off = (fit.unknowns - c.fit.unknowns)[free]
        squares += float(off @ fit.information @ off)
        sigma = np.sqrt(np.diag(fit.covariance(problem.free)))[free]
        worst = max(worst, float(np.abs(off / sigma).max()))
    count = twins * len(free)
    low, high = stats.chi2.ppf([BY_CHANCE / 2.0, 1.0 - BY_CHANCE / 2.0], count) / count
    return SelfTest(squares / count, (float(low), float(high)), worst)


def _twin(problem: Problem, s: Sightings, unknowns: Array, rng: np.random.Generator) -> Sightings:
    """The same images, with corners and readings drawn anew about what was found."""
    errors = np.zeros_like(s.readings)
    for j, sigma in enumerate(problem.reading_sigma):
        if sigma > 0.0:
            _, back = np.unique(s.reading_ids[:, j], return_inverse=True)
            errors[:, j] = rng.normal(0.0, sigma, back.max() + 1)[back]
    T = s.evaluate(unknowns, errors).T
    at = np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3]
    drawn = problem.camera.project(at) + rng.normal(size=s.pixels.shape) * s.sigma(problem.pixel_sigma)
    return replace(s, pixels=np.where(np.isfinite(s.pixels), drawn, np.nan))
