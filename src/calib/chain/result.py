"""A calibrated chain as a value: the unknowns with their covariance, how well they predict, and what is doubtful."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, frozen
from calib.chain.fit import ChainFit, Problem, Sightings, fit_chains
from calib.chain.model_selection import Choice, Part, Trial, choose_model, largest_rise
from calib.chain.score_tests import ChainSuspect, find_suspects, sudden_change

FOLDS = 5
CHANCE = 1e-4  # how often a complete model is refused for its residuals
CORRELATED = 0.9
_TELLING = (
    2  # measurements beyond the unknowns, for each that is optional, from which exact readings are believed
)
SIZE = 1e-3  # part of a target's size that its maker may be off by


@dataclass(frozen=True)
class ChainLimits:
    """When a chain's calibration is refused.

    Attributes:
        chi2_dof: largest cost per degree of freedom: above it, something moves that the model does not know. Of few
            images it may be larger by chance, see `ChainCalibration.chi2_limit`.
        held_out: largest error of predictions that were held out, m.
        wrong: largest part of the images that may be left out as wrong.
        images: fewest images that are used.
        undetermined: standard deviations from which an angle (rad) and a length (m) are not determined.
    """

    chi2_dof: float = 1.25
    held_out: float = 1e-3
    wrong: float = 0.4
    images: int = 8
    undetermined: tuple[float, float] = (np.radians(2.0), 0.02)


@dataclass(frozen=True)
class HeldOut:
    """How well images are predicted by fits that do not know them.

    Attributes:
        px: rms of the residuals' coordinates.
        metres: rms distance, across the line of sight, of the target's middle from where it was predicted; inf if an
            image was predicted where the camera sees nothing, behind it for one.
    """

    px: float
    metres: float


@dataclass(frozen=True, eq=False)
class ChainCalibration:
    """A fit of the model that was chosen.

    Attributes:
        names: of all unknowns.
        lengths: (count,) which unknowns are lengths; the others are angles, or make angles.
        problem: with the chosen unknowns free.
        fit: of it; weights 0 for images that were left out.
        trials: what each optional part of the model is worth.
        held_out: from `FOLDS` fits that each lack a part of the stances.
        suspects: what else could be wrong, most telling first.
        iterations: steps from the start to the solution, with the model that was chosen.
        solve_s: how long that took.
        limits: of the verdict.
        noise_freedom: measurements that the corners' noise was estimated from.
        change: image from which on images do not fit those before it; None if there is none.
        reasons: why it is refused; empty if it is accepted.
        remarks: what a person should know besides.
    """

    names: tuple[str, ...]
    lengths: npt.NDArray[np.bool_]
    problem: Problem
    fit: ChainFit
    trials: tuple[Trial, ...]
    held_out: HeldOut
    suspects: tuple[ChainSuspect, ...]
    iterations: int
    solve_s: float
    limits: ChainLimits
    noise_freedom: float = np.inf
    change: int | None = None
    reasons: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def accepted(self) -> bool:
        """The verdict."""
        return not self.reasons

    @property
    def chi2_limit(self) -> float:
        """Largest cost per degree of freedom that is accepted: that of the limits, or what chance makes of few images
        if that is more."""
        return _chi2_limit(self.limits, self.fit, self.noise_freedom)

    @property
    def excess(self) -> float:
        """Cost per degree of freedom of what images say of each other (`ChainFit.excess`)."""
        return self.fit.excess(self.noise_freedom)

    @property
    def excess_limit(self) -> float:
        """What chance makes of it."""
        more = _more(self.fit, self.noise_freedom)
        return largest_rise(CHANCE, more, self.noise_freedom) / more

    @property
    def images(self) -> int:
        """How many there are."""
        return sum(len(w) for w in self.fit.weights)

    @property
    def wrong(self) -> tuple[npt.NDArray[np.intp], ...]:
        """Images of every chain that were left out as wrong."""
        return tuple(np.flatnonzero(w == 0.0) for w in self.fit.weights)

    @cached_property
    def covariance(self) -> Array:
        """Of all unknowns, SI; zero where held. Wider than the fit says by what its residuals are too large, and by
        what the target's size may be off (`SIZE`), which links of unknown length make up for."""
        covariance = self.fit.covariance(self.problem.free) * max(1.0, self.excess)
        size = next((s for s in self.suspects if s.name == "target size" and len(s.others)), None)
        if size is not None:  # inverse of the blocks with the size as one more unknown
            by_size = np.zeros(len(covariance))
            by_size[self.problem.free] = size.others
            covariance += np.outer(by_size, by_size) / (size.sigma**-2 + SIZE**-2)
        return frozen(covariance)

    @cached_property
    def residual_std(self) -> Array:
        """Standard deviation of the residuals in x and y with the readings taken as exact, (2,) px."""
        return _std(self.problem, self.fit, [np.zeros_like(e) for e in self.fit.errors])

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
        """The combination of unknowns that the images tell least of: names and shares, largest first, of those that
        matter, each in its own standard deviation if the others were known."""
        free = np.flatnonzero(self.problem.free)
        scale = 1.0 / np.sqrt(np.diag(self.fit.information))
        _, vectors = np.linalg.eigh(self.fit.information * np.outer(scale, scale))
        weak = vectors[:, 0]
        order = np.argsort(-np.abs(weak))[:4]
        return tuple((self.names[free[i]], float(weak[i])) for i in order if abs(weak[i]) > 0.2)


def calibrate_chain(
    names: Sequence[str],
    lengths: npt.NDArray[np.bool_],
    problem: Problem,
    parts: Sequence[Part],
    limits: ChainLimits,
    weights: Sequence[Array] | None = None,
    noise_freedom: float = np.inf,
    refined: Callable[[Choice], Choice] = lambda choice: choice,
    readings: Sequence[str] = (),
    step_known: bool = False,
) -> ChainCalibration:
    """Choose a model, fit it, hold images out, and look for what else could be wrong; the verdict is not yet made.

    Args:
        names: of all unknowns.
        lengths: (count,) which are lengths.
        problem: with all unknowns of all parts free.
        parts: of the model that may be left out.
        limits: of the verdict.
        weights: of a start that knows some images to be wrong, (n,) of every chain.
        noise_freedom: measurements that the problem's `pixel_sigma` rests on.
        refined: makes more of a choice, such as a better shape of one of its parts.
        readings: their names, in a single chain.
        step_known: whether `reading_sigma` is certain; otherwise readings that explain everything are taken as exact.
    """
    if not step_known:
        problem = _exact_if_it_fits(problem, parts, limits, noise_freedom)
    choice = refined(choose_model(problem, parts, weights, noise_freedom))
    began = time.perf_counter()
    again = fit_chains(choice.problem, choice.fit.weights)
    took = time.perf_counter() - began
    fit = again if again.cost <= choice.fit.cost * (1.0 + 1e-9) else choice.fit
    change = sudden_change(fit.weights[0] == 0.0) if len(fit.weights) == 1 else None
    believed = fit if change is None else replace(fit, weights=(_either_side(choice.problem, fit, change),))
    return ChainCalibration(
        tuple(names),
        lengths,
        choice.problem,
        fit,
        choice.trials,
        hold_out(choice),
        find_suspects(choice.problem, believed, noise_freedom, readings),
        again.iterations,
        took,
        limits,
        noise_freedom,
        change,
    )


def _either_side(problem: Problem, fit: ChainFit, change: int) -> Array:
    """Weights with which images on both sides of a change are believed, (n,): nearly all of one side are wrong only
    because the other was taken for right."""
    wrong = fit.weights[0] == 0.0
    after = np.arange(len(wrong)) >= change
    mistaken = after == (wrong[after].mean() > wrong[~after].mean())
    off = np.sqrt(np.nanmean((fit.residuals[0] / problem.pixel_sigma) ** 2, axis=(1, 2)))
    usual = float(np.median(off[mistaken & wrong]))
    return np.where(wrong & mistaken & (off < 3.0 * usual), 1.0, fit.weights[0])


def chi2_limit(limits: ChainLimits, known: int, more: int, noise_freedom: float) -> float:
    """See `ChainCalibration.chi2_limit`.

    The noise is known from the images alone; what an arm between them adds to their squares varies by chance, the more
    the fewer they are.

    Args:
        limits: of the verdict.
        known: degrees of freedom of the images alone.
        more: degrees of freedom beyond those.
        noise_freedom: measurements that the noise was estimated from; infinite if it was given.
    """
    return max(limits.chi2_dof, (known + largest_rise(CHANCE, more, noise_freedom)) / (known + more))


def _chi2_limit(limits: ChainLimits, fit: ChainFit, noise_freedom: float) -> float:
    more = _more(fit, noise_freedom)
    return chi2_limit(limits, max(fit.freedom - more, 0), more, noise_freedom)


def _more(fit: ChainFit, noise_freedom: float) -> int:
    """Degrees of freedom beyond the images' own that the noise was estimated from."""
    return max(fit.freedom - (fit.own if np.isfinite(noise_freedom) else 0), 1)


def _exact_if_it_fits(
    problem: Problem, parts: Sequence[Part], limits: ChainLimits, noise_freedom: float
) -> Problem:
    """With readings taken as exact where that explains everything: a grid may be that of the commands.

    Of few images nothing is explained by exact readings that optional unknowns would not swallow.
    """
    if not (problem.reading_sigma > 0.0).any():
        return problem
    exact = replace(problem, reading_sigma=np.zeros_like(problem.reading_sigma))
    fit = fit_chains(exact)
    optional = {place for part in parts for place in part.unknowns}
    known = int(np.isfinite(problem.prior_sigma[problem.free]).sum())
    if _more(fit, noise_freedom) - known < _TELLING * len(optional):
        return problem
    return exact if fit.chi2_dof < _chi2_limit(limits, fit, noise_freedom) else problem


def hold_out(choice: Choice, folds: int = FOLDS) -> HeldOut:
    """Predict each part of the stances from a fit to the others."""
    problem, fit = choice.problem, choice.fit
    squares, count, metres, lost = 0.0, 0, [], False
    for fold in range(folds):
        parts = [_fold(s, folds) == fold for s in problem.sightings]
        weights = [np.where(part, 0.0, w) for part, w in zip(parts, fit.weights, strict=True)]
        known = fit_chains(problem, weights, fit)
        for s, part, w in zip(problem.sightings, parts, fit.weights, strict=True):
            images = np.flatnonzero(part & (w > 0.0))
            if not len(images):
                continue
            r, depth = _predicted(problem, s, images, known.unknowns)
            squares += float(np.nansum(r**2))
            count += int(np.isfinite(r).sum())
            focal = np.diag(problem.camera.K)[:2]
            seen, there = (np.isfinite(v).any(axis=(1, 2)) for v in (r, s.pixels[images]))
            lost = lost or bool(np.any(there & ~seen))
            metres.append(np.linalg.norm(np.nanmean(r[seen], axis=1) / focal * depth[seen, None], axis=1))
    if not count:
        return HeldOut(float("nan"), float("nan"))
    rms = float("inf") if lost else float(np.sqrt(np.mean(np.concatenate(metres) ** 2)))
    return HeldOut(float(np.sqrt(squares / count)), rms)


def _fold(s: Sightings, folds: int) -> npt.NDArray[np.intp]:
    _, place = np.unique(s.stances, return_inverse=True)
    return np.asarray(place % folds, dtype=np.intp)


def _predicted(
    problem: Problem, s: Sightings, images: npt.NDArray[np.intp], unknowns: Array
) -> tuple[Array, Array]:
    """Residuals (k, m, 2) px of images predicted from their readings, and the target's depth, (k,) m."""
    some = replace(
        s,
        readings=s.readings[images],
        reading_ids=s.reading_ids[images],
        stances=s.stances[images],
        pixels=s.pixels[images],
    )
    T = some.evaluate(unknowns, np.zeros_like(some.readings)).T
    at = np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3]
    return some.pixels - problem.camera.project(at), at[..., 2].mean(axis=1)


def _std(problem: Problem, fit: ChainFit, errors: Sequence[Array]) -> Array:
    residuals = []
    for s, w, e in zip(problem.sightings, fit.weights, errors, strict=True):
        images = np.flatnonzero(w > 0.0)
        T = s.evaluate(fit.unknowns, e).T[images]
        at = np.einsum("nij,mj->nmi", T[:, :3, :3], s.points) + T[:, None, :3, 3]
        residuals.append((s.pixels[images] - problem.camera.project(at)).reshape(-1, 2))
    return np.asarray(np.nanstd(np.concatenate(residuals), axis=0))
