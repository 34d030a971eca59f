"""Score tests for model errors of a calibrated chain, such as a wrong target size: how much would each one explain?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import special

from arm.se3 import Array, Bools, Indices
from calib.chain.fit import ChainFit, NormalEquations, Problem, Sightings, normal_equations
from calib.chain.model_selection import largest_rise
from calib.chain.repeatability import Scattering
from calib.chain.scatter import Sizes, equations_of, estimate_sizes, reduced
from calib.model.chain import Evaluated
from calib.model.chi_square import chi2_limit
from calib.model.least_squares import inverse_scaled
from calib.model.score_test import score_test
from vision.camera.model import Camera
from vision.camera.projection import Projection, along

SURE = 1e-5  # false alarm rate
_ACROSS = 3.0  # six over two: an arm's scatter affects two of a pose's six degrees of freedom, across the line of sight
_MOST = 0.5  # relative, or m; a linear test is invalid for larger amounts


@dataclass(frozen=True, eq=False)
class ChainErrorHypothesis:
    """A possible model error.

    Attributes:
        name: "target size", "time skew", "focal length", "target moved", "camera moved", "scale of" a reading.
        amount: its size in `unit` (for a movement: the distance).
        sigma: standard deviation of the amount, if the model is complete otherwise.
        unit: "" for a relative amount.
        drop: of the cost, if the model included it.
        limit: largest insignificant drop.
        moves: rms shift of predicted targets at the images' readings, m.
        image: first image after a movement; -1 otherwise.
        others: (free,) change of the other unknowns for an amount of 1; empty for a movement.
    """

    name: str
    amount: float
    sigma: float
    unit: str
    drop: float
    limit: float
    moves: float = 0.0
    image: int = -1
    others: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def sure(self) -> bool:
        """Whether it is significant, and small enough for a linear test."""
        return self.drop > self.limit and abs(self.amount) < _MOST


def _columns(s: Sightings, at: Evaluated, camera: Camera, readings: Sequence[str]) -> dict[str, Array]:
    """Derivatives of the projected points by model errors, (n, m, 2, k) px; `readings` are named for a single chain."""
    projection = Projection(camera, at.T, s.points)
    by_reading = along(projection.by_target, at.by_reading)
    back = np.zeros_like(s.readings)
    back[1:] = s.readings[:-1] - s.readings[1:]
    columns = {
        "target size": projection.by_point @ s.points[..., None],
        "focal length": (projection.pixels - camera.K[:2, 2])[..., None],
        "time skew": by_reading @ back[:, None, :, None],
    }
    for j, name in enumerate(readings):
        columns[f"scale of {name}"] = by_reading[..., [j]] * s.readings[:, None, None, [j]]
    moved = {"target moved": projection.by_target, "camera moved": projection.by_camera}
    return columns | moved if readings else columns


def find_error_hypotheses(
    problem: Problem, fit: ChainFit, readings: Sequence[str] = ()
) -> tuple[ChainErrorHypothesis, ...]:
    """Test all known model errors, the most significant first.

    Args:
        problem: of the fit.
        fit: without the errors.
        readings: their names, for a single chain; default: their numbers.
    """
    at = [s.evaluate(fit.unknowns, e) for s, e in zip(problem.sightings, fit.errors, strict=True)]
    single = len(at) == 1
    readings = (readings or [f"reading {j}" for j in range(len(problem.reading_sigma))]) if single else ()
    columns = [_columns(s, a, problem.camera, readings) for s, a in zip(problem.sightings, at, strict=True)]
    together = [np.concatenate(list(of.values()), axis=-1) for of in columns]
    moves = [np.swapaxes(a.by_unknown[:, problem.free, :3], 1, 2) for a in at]
    shifts = np.concatenate([m[w > 0.0] for m, w in zip(moves, fit.weights, strict=True)])
    tests = _ScoreTests(problem, fit, normal_equations(problem, fit, together), shifts)
    found: list[ChainErrorHypothesis] = []
    place = 0
    for name, of in columns[0].items():
        chosen = slice(place, place + of.shape[-1])
        place = chosen.stop
        found += tests.named(name, chosen)
    return most_significant_first(found)


def find_errors_despite_scatter(arm: Scattering, readings: Sequence[str]) -> tuple[ChainErrorHypothesis, ...]:
    """Test all known model errors of an arm that scatters, the most significant first.

    The sizes of the scatter are estimated anew with each error in the model: what the error explains is not scatter.

    Args:
        arm: without the errors, of a single chain.
        readings: their names.
    """
    problem, fit = arm.choice.problem, arm.choice.fit
    s = problem.sightings[0]
    at = s.evaluate(fit.unknowns)
    found: list[ChainErrorHypothesis] = []
    used = fit.weights[0] > 0.0
    shifts = np.swapaxes(at.by_unknown[used][:, problem.free, :3], 1, 2)
    for name, column in _columns(s, at, problem.camera, readings).items():
        chosen = slice(0, column.shape[-1])

        def tests(of: Sizes, column: Array = column) -> _ScoreTests:
            data = reduced(problem, fit, arm.base, arm.smooth, column)
            return _ScoreTests(problem, fit, equations_of(data, of), shifts, arm.freedom)

        movements = tests(arm.sizes).movement(name, chosen) if "moved" in name else []
        first = movements[0].image if movements else 0
        after = (np.arange(len(used)) >= first)[:, None, None, None]
        data = reduced(problem, fit, arm.base, arm.smooth, column * after)
        found += tests(estimate_sizes(data, begin=arm.sizes)).named(name, chosen)
    return most_significant_first(found)


def most_significant_first(found: Sequence[ChainErrorHypothesis]) -> tuple[ChainErrorHypothesis, ...]:
    """Sort hypotheses by their drop of the cost, relative to its limit."""
    return tuple(sorted(found, key=lambda hypothesis: -hypothesis.drop / hypothesis.limit))


class _ScoreTests:
    """Score tests of further unknowns, which may act from some stance on.

    Args:
        problem, fit: without them.
        equations: of every stance for the free unknowns, then those tested.
        shifts: of the used targets by the free unknowns, (images, 3, free) m.
        freedom: measurements that the sizes of all errors were estimated from, if the arm's scatter is among them.
    """

    def __init__(
        self,
        problem: Problem,
        fit: ChainFit,
        equations: NormalEquations,
        shifts: Array,
        freedom: float | None = None,
    ) -> None:
        n = shifts.shape[2]
        S, g = equations.total
        self._fit, self._shifts, self._noise_freedom = fit, shifts, problem.noise_freedom
        self._freedom = freedom
        self._covariance, self._gradient = inverse_scaled(S[:n, :n]), g[:n]
        S_from = np.cumsum(equations.S[::-1, :, n:], axis=0)[::-1]
        self._coupling, self._tested = S_from[:, :n], S_from[:, n:]
        self._tested_gradient = np.cumsum(equations.g[::-1, n:], axis=0)[::-1]
        self._first_images = _first_images(problem, fit)

    def of(self, name: str, unit: str, chosen: slice, first: int = 0, tries: int = 1) -> ChainErrorHypothesis:
        """Test unknowns that act from stance `first` on, the likeliest of several `tries`."""
        test = score_test(
            self._covariance,
            self._gradient,
            self._coupling[first, :, chosen],
            self._tested[first, chosen, chosen],
            self._tested_gradient[first, chosen],
        )
        amount, sigmas, k = test.amount, np.sqrt(np.diag(test.covariance)), len(test.amount)
        # excess scatter of the arm makes every error look significant; what the error explains is not scatter
        scatter = 1.0 + _ACROSS * max(0.0, self._fit.excess(self._noise_freedom, test.drop, k) - 1.0)
        limit = largest_rise(SURE / tries, k, self._noise_freedom) * scatter
        if self._freedom is not None:
            limit = largest_rise(SURE / tries, k, self._freedom)
        if k > 1:
            size, sigma = float(np.linalg.norm(amount[:3])), float(np.linalg.norm(sigmas[:3]))
            image = self._first_images[first]
            return ChainErrorHypothesis(name, size, sigma, unit, test.drop, limit, size, image)
        moves = self._shifts @ (test.others @ amount)
        rms, others = float(np.sqrt(np.mean(np.sum(moves**2, axis=1)))), test.others[:, 0]
        return ChainErrorHypothesis(
            name, float(amount[0]), float(sigmas[0]), unit, test.drop, limit, rms, -1, others
        )

    def named(self, name: str, chosen: slice) -> list[ChainErrorHypothesis]:
        """Test the error of a name of `_columns`."""
        if "moved" in name:
            return self.movement(name, chosen)
        return [self.of(name, "of the way from the last pose" if name == "time skew" else "", chosen)]

    def movement(self, name: str, chosen: slice) -> list[ChainErrorHypothesis]:
        """Test a single movement between two stances, at the most likely time."""
        times = range(1, len(self._coupling))
        tests = [self.of(name, "m", chosen, first, len(times)) for first in times]
        return [max(tests, key=lambda test: test.drop)] if tests else []


def _first_images(problem: Problem, fit: ChainFit) -> list[int]:
    """First used image of every stance, in the order of chains and stances."""
    found: list[int] = []
    for s, w in zip(problem.sightings, fit.weights, strict=True):
        used = np.flatnonzero(w > 0.0)
        found += [int(used[i]) for i in np.unique(s.stances[used], return_index=True)[1]]
    return found


def sudden_change(wrong: Bools) -> int | None:
    """Find the first image after which wrong images are much more or less frequent; None if there is no such change.

    If two halves of the images do not fit each other, one half is rejected. The test is a likelihood ratio of two rates
    of wrong images against one.
    """
    n = len(wrong)
    if n < 2 or not wrong.any():
        return None
    so_far, k = np.cumsum(wrong.astype(np.intp)), np.arange(1, n)
    before, total = so_far[:-1], so_far[-1:]
    gain = _log_likelihood(before, k) + _log_likelihood(total - before, n - k)
    drop = 2.0 * (gain - _log_likelihood(total, np.array([n])))
    best = int(np.argmax(drop))
    return best + 1 if drop[best] > chi2_limit(SURE / n, 1) else None


def _log_likelihood(wrong: Indices, of: Indices) -> Array:
    """Log likelihood of that many wrong images, at their own rate."""
    right = of - wrong
    return np.asarray(special.xlogy(wrong, wrong / of) + special.xlogy(right, right / of))
