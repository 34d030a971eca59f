"""Result of a chain calibration: unknowns with their covariance, cross-validation, and score tests."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from arm.former import former_names, renamed_arguments
from arm.se3 import Array, Bools, Indices, frozen
from calib.chain.cross_validation import FOLDS as FOLDS
from calib.chain.cross_validation import CrossValidation as CrossValidation
from calib.chain.cross_validation import cross_validate as cross_validate
from calib.chain.fit import ChainFit, Problem, fit_chains, normal_equations
from calib.chain.model_selection import Choice, Part, Trial, choose_model, largest_rise
from calib.chain.repeatability import Scattering, fit_scattering
from calib.chain.score_tests import (
    ChainErrorHypothesis,
    find_error_hypotheses,
    find_errors_despite_scatter,
    sudden_change,
)
from calib.chain.single_cause import UNEXPLAINED, prefer_single_causes
from calib.model.least_squares import embedded, inverse_scaled
from calib.model.verdict import Judged

CHANCE = 1e-4  # probability of refusing a complete model for its residuals
CORRELATED = 0.9
_INFORMATIVE = 2  # degrees of freedom per optional unknown needed to conclude that readings are exact
_EITHER_SIDE = 6  # images
# Of the images: more than wrong detections explain, alone, or if others disagree too.
_MANY_WRONG, _SOME_WRONG = 0.4, 0.1
SIZE = 1e-3  # relative tolerance of a target's size


@dataclass(frozen=True)
class ChainLimits:
    """Limits for accepting a chain calibration.

    Attributes:
        chi2_dof: largest cost per degree of freedom of a complete model; higher with few images, because of chance, see
            `ChainCalibration.chi2_limit`.
        held_out: largest error of held-out predictions, m.
        wrong: largest fraction of rejected images.
        images: fewest images used.
        undetermined: standard deviation above which an angle (rad) and a length (m) are undetermined.
    """

    chi2_dof: float = 1.25
    held_out: float = 1e-3
    wrong: float = 0.4
    images: int = 8
    undetermined: tuple[float, float] = (np.radians(2.0), 0.02)


@renamed_arguments(suspects="hypotheses")
@dataclass(frozen=True, eq=False)
class ChainCalibration(Judged):
    """A fit of the selected model.

    Attributes:
        names: of all unknowns.
        lengths: (count,) whether an unknown is a length; the others are angles, or factors of angles.
        problem: with the selected unknowns free.
        fit: of it; weights 0 for rejected images.
        trials: trial of each optional part of the model.
        held_out: from `FOLDS` fits, each without a part of the stances.
        hypotheses: possible model errors, the most significant first.
        iterations: steps from the start to the solution, with the selected model.
        solve_s: their time.
        limits: of the verdict.
        change: first image that no longer fits those before it; None if there is none.
        scattering: the scatter of an arm that does not repeat as well as the corners would show; None without.
        known: unknowns that exist by their prior, even if the images do not show them: among them the target's size.
    """

    names: tuple[str, ...]
    lengths: Bools
    problem: Problem
    fit: ChainFit
    trials: tuple[Trial, ...]
    held_out: CrossValidation
    hypotheses: tuple[ChainErrorHypothesis, ...]
    iterations: int
    solve_s: float
    limits: ChainLimits
    change: int | None = None
    scattering: Scattering | None = None
    known: tuple[int, ...] = ()

    @property
    def considered(self) -> tuple[int, ...]:
        """Those of the `known` unknowns that are not in the model because the images do not show them."""
        return tuple(i for i in self.known if not self.problem.free[i])

    @property
    def chi2_limit(self) -> float:
        """Largest accepted cost per degree of freedom: that of `limits`, or what chance explains if it is larger."""
        return chi2_limit(
            self.limits, *_freedoms(self.fit, self.problem.noise_freedom), self.problem.noise_freedom
        )

    @property
    def excess(self) -> float:
        """Cost per degree of freedom between images (`ChainFit.excess`)."""
        return self.fit.excess(self.problem.noise_freedom)

    @property
    def excess_limit(self) -> float:
        """Largest `excess` that chance explains."""
        _, more = _freedoms(self.fit, self.problem.noise_freedom)
        return largest_rise(CHANCE, more, self.problem.noise_freedom) / more

    @property
    def images(self) -> int:
        """Number of images."""
        return sum(len(w) for w in self.fit.weights)

    @property
    def wrong(self) -> tuple[Indices, ...]:
        """Rejected images of every chain."""
        return self.fit.wrong

    @cached_property
    def covariance(self) -> Array:
        """Covariance of all unknowns, SI; zero where held.

        It is inflated by `excess`, and by the tolerance of the target's size (`SIZE`), which link errors can absorb.
        """
        if self.considered:
            return frozen(self._with_considered())
        covariance = self.fit.covariance(self.problem.free) * max(1.0, self.excess)
        size = next((s for s in self.hypotheses if s.name == "target size" and len(s.others)), None)
        if size is not None and not self.known:
            # inverse of the blocks with the size as one more unknown
            by_size = np.zeros(len(covariance))
            by_size[self.problem.free] = size.others
            covariance += np.outer(by_size, by_size) / (size.sigma**-2 + SIZE**-2)
        return frozen(covariance)

    def _with_considered(self) -> Array:
        """Mean square errors of the unknowns (count, count), if those considered deviate from zero by their prior.

        The images say where they lie, but the fit has not followed, as that is within chance: the step that it would
        have made is part of the error.
        """
        free = self.problem.free.copy()
        free[list(self.considered)] = True
        equations = normal_equations(replace(self.problem, free=free), self.fit)
        information, gradient = equations.total
        covariance = inverse_scaled(information)
        step = covariance @ gradient
        both = embedded(covariance * max(1.0, self.excess) + np.outer(step, step), free)
        both[list(self.considered)], both[:, list(self.considered)] = 0.0, 0.0
        return both

    @cached_property
    def residual_std(self) -> Array:
        """Standard deviation of the residuals in x and y with the readings assumed exact, (2,) px."""
        residuals = [
            (s.pixels - s.predicted(self.problem.camera, self.fit.unknowns))[w > 0.0].reshape(-1, 2)
            for s, w in zip(self.problem.sightings, self.fit.weights, strict=True)
        ]
        return np.asarray(np.nanstd(np.concatenate(residuals), axis=0))

    @cached_property
    def correlations(self) -> tuple[tuple[str, str, float], ...]:
        """Pairs of free unknowns whose correlation is above `CORRELATED`, strongest first."""
        free = np.flatnonzero(self.problem.free)
        sigma = np.sqrt(np.diag(self.covariance))[free]
        matrix = self.covariance[np.ix_(free, free)] / np.outer(sigma, sigma)
        pairs = [
            (self.names[a], self.names[b], float(matrix[i, j]))
            for i, a in enumerate(free)
            for j, b in enumerate(free[:i])
            if abs(matrix[i, j]) > CORRELATED
        ]
        return tuple(sorted(pairs, key=lambda pair: -abs(pair[2])))

    @cached_property
    def weakest(self) -> tuple[tuple[str, float], ...]:
        """The least determined combination of unknowns: names and coefficients, largest first.

        The unit of a coefficient is the standard deviation that the unknown would have if the others were known.
        """
        free = np.flatnonzero(self.problem.free)
        scale = 1.0 / np.sqrt(np.diag(self.fit.information))
        _, vectors = np.linalg.eigh(self.fit.information * np.outer(scale, scale))
        weak = vectors[:, 0]
        order = np.argsort(-np.abs(weak))[:4]
        return tuple((self.names[free[i]], float(weak[i])) for i in order if abs(weak[i]) > 0.2)


def calibrate_chain(
    names: Sequence[str],
    lengths: Bools,
    problem: Problem,
    parts: Sequence[Part],
    limits: ChainLimits,
    weights: Sequence[Array] | None = None,
    refined: Callable[[Choice], Choice] = lambda choice: choice,
    readings: Sequence[str] = (),
    step_known: bool = False,
    smooth: Sequence[int] | None = None,
) -> ChainCalibration:
    """Select a model, fit it, cross-validate, and run the score tests; the verdict is not yet made.

    Args:
        names: of all unknowns.
        lengths: (count,) whether they are lengths.
        problem: with the unknowns of all parts free.
        parts: of the model that may be dropped.
        limits: of the verdict.
        weights: initial weights, 0 for images known to be wrong, (n,) of every chain.
        refined: refines a choice, such as the shape of one of its parts.
        readings: their names, for a single chain.
        step_known: whether `reading_sigma` is certain; otherwise readings are assumed exact if that fits.
        smooth: indices of the unknowns that are smooth errors of the joints, held until the arm is seen to scatter;
            None: it does not scatter.
    """
    if not step_known:
        problem = _exact_if_it_fits(problem, parts, limits)
    choice = refined(choose_model(problem, parts, weights))
    if smooth is not None:
        choice = prefer_single_causes(choice, parts, readings)
    began = time.perf_counter()
    again = fit_chains(choice.problem, choice.fit.weights)
    took = time.perf_counter() - began
    fit = again if again.cost <= choice.fit.cost * (1.0 + 1e-9) else choice.fit
    change = sudden_change(fit.weights[0] == 0.0) if len(fit.weights) == 1 else None
    believed = fit if change is None else replace(fit, weights=(_either_side(choice.problem, fit, change),))
    hypotheses = find_error_hypotheses(choice.problem, believed, readings)
    found = ChainCalibration(
        tuple(names),
        lengths,
        choice.problem,
        fit,
        choice.trials,
        cross_validate(choice),
        hypotheses,
        again.iterations,
        took,
        limits,
        change,
        known=tuple(i for part in parts if part.known for i in part.unknowns),
    )
    if smooth is None:
        return found
    sure = scatters(found)
    if not sure and not any(trial.needed for trial in found.trials):
        return found
    s = fit_scattering(problem, parts, fit, smooth)
    if not sure and not _explains_with_less(s, problem, parts, choice, limits):
        return found
    return replace(
        found,
        problem=s.choice.problem,
        fit=s.choice.fit,
        trials=s.choice.trials,
        held_out=cross_validate(s.choice),
        hypotheses=find_errors_despite_scatter(s, readings),
        change=sudden_change(s.choice.fit.weights[0] == 0.0),
        scattering=s,
    )


def _explains_with_less(
    s: Scattering, problem: Problem, parts: Sequence[Part], other: Choice, limits: ChainLimits
) -> bool:
    """Whether a small scatter does what another model does with more unknowns, such as errors of the links.

    Small: without scatter too, the residuals are within the limit of the verdict. Then the images do not tell a few
    hundredths of a pixel of sway from links that move by as little, and links take errors of the print in with it.
    """
    if _size(parts, s.choice) >= _size(parts, other):
        return False
    bare = replace(problem, free=s.choice.problem.free & problem.free)
    return fit_chains(bare, s.choice.fit.weights).chi2_dof <= limits.chi2_dof


def _size(parts: Sequence[Part], choice: Choice) -> int:
    """Number of unknowns of the parts that a model needs."""
    needed = {trial.part for trial in choice.trials if trial.needed}
    return sum(len(part.unknowns) for part in parts if part.name in needed)


def scatters(c: ChainCalibration) -> bool:
    """Whether the images disagree by more than chance and any single cause explain, so that the arm scatters.

    A cause that explains the images that are left does not explain why others were rejected.
    """
    wrong = sum(map(len, c.wrong)) / c.images
    disagree = c.excess > max(c.excess_limit, 1.0)
    if not disagree and wrong <= _MANY_WRONG:
        return False
    if c.change is None and wrong > (_SOME_WRONG if disagree else _MANY_WRONG):
        return True
    causes = [s for s in c.hypotheses if s.sure and _on_both_sides(c, s)]
    left = [c.fit.excess(c.problem.noise_freedom, s.drop, 1) for s in causes]
    most = 1.0 + UNEXPLAINED * (c.excess - 1.0)
    if any(trial.instead for trial in c.trials):  # what is left is as good as a part: chance may be all of it
        most = max(most, c.excess_limit)
    return not left or min(left) > most


def _on_both_sides(c: ChainCalibration, s: ChainErrorHypothesis) -> bool:
    """Whether enough images lie before and after a movement: its six unknowns fit any two images."""
    if s.image < 0:
        return True
    used = c.fit.weights[0] > 0.0
    return min(int(used[: s.image].sum()), int(used[s.image :].sum())) >= _EITHER_SIDE


def _either_side(problem: Problem, fit: ChainFit, change: int) -> Array:
    """Weights (n,) with the rejected side of a change restored: its images only disagree with those of the other."""
    wrong = fit.weights[0] == 0.0
    after = np.arange(len(wrong)) >= change
    mistaken = after == (wrong[after].mean() > wrong[~after].mean())
    off = np.sqrt(np.nanmean((fit.residuals[0] / problem.pixel_sigma) ** 2, axis=(1, 2)))
    usual = float(np.median(off[mistaken & wrong]))
    return np.where(wrong & mistaken & (off < 3.0 * usual), 1.0, fit.weights[0])


def chi2_limit(limits: ChainLimits, known: int, more: int, noise_freedom: float) -> float:
    """See `ChainCalibration.chi2_limit`.

    The noise is known from the images alone. The cost that the arm adds varies by chance, the more the fewer degrees of
    freedom it has.

    Args:
        limits: of the verdict.
        known: degrees of freedom of the images alone.
        more: further degrees of freedom.
        noise_freedom: measurements that the noise was estimated from; infinite if it was given.
    """
    return max(limits.chi2_dof, (known + largest_rise(CHANCE, more, noise_freedom)) / (known + more))


def _freedoms(fit: ChainFit, noise_freedom: float) -> tuple[int, int]:
    """Degrees of freedom of the images alone, from which the noise was estimated, and the others."""
    more = max(fit.freedom - (fit.own if np.isfinite(noise_freedom) else 0), 1)
    return max(fit.freedom - more, 0), more


def _exact_if_it_fits(problem: Problem, parts: Sequence[Part], limits: ChainLimits) -> Problem:
    """Assume exact readings if the images agree: a grid in the readings may come from the commands.

    With few images the optional unknowns could absorb reading errors, so the problem is returned unchanged.
    """
    if not (problem.reading_sigma > 0.0).any():
        return problem
    exact = replace(problem, reading_sigma=np.zeros_like(problem.reading_sigma))
    fit = fit_chains(exact)
    optional = {place for part in parts for place in part.unknowns}
    priors = int(np.isfinite(problem.prior_sigma[problem.free]).sum())
    known, more = _freedoms(fit, problem.noise_freedom)
    if more - priors < _INFORMATIVE * len(optional):
        return problem
    limit = chi2_limit(limits, known, more, problem.noise_freedom)
    return exact if fit.chi2_dof < limit else problem


former_names(__name__, __name__, hold_out="cross_validate", HeldOut="CrossValidation")
