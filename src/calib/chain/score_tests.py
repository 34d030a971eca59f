"""Score tests for model errors of a calibrated chain: how much would each explain?

A model error is a further unknown that the fit lacks, such as a wrong target size. Its size and significance follow
from the gradient of the cost at the solution, with all other unknowns free (C. R. Rao's score test, 1948). No refit is
needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import special, stats

from arm.se3 import Array, by_twist
from calib.camera.bundle_adjustment import inverse_scaled, solve_scaled
from calib.chain.fit import ChainFit, NormalEquations, Problem, Sightings, normal_equations
from calib.chain.model_selection import largest_rise

SURE = 1e-5  # probability that an error that is not there looks as significant
_ACROSS = 3.0  # an arm's scatter shows in two of a pose's six degrees of freedom: across the line of sight
_MOST = 0.5  # relative, or m; larger amounts are beyond a linear test


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


@dataclass(frozen=True, eq=False)
class _View:
    """Derivatives at a fit.

    In px: by the target's points (n, m, 2, 3), by the target's and the camera's twist (..., 6), by the readings. In m:
    shift of the target by the free unknowns, (n, 3, free). `projected` is (n, m, 2).
    """

    s: Sightings
    projected: Array
    by_point: Array
    by_target: Array
    by_camera: Array
    by_reading: Array
    target_by_free: Array

    @classmethod
    def of(cls, problem: Problem, s: Sightings, unknowns: Array, errors: Array) -> _View:
        at = s.evaluate(unknowns, errors)
        R = at.T[:, :3, :3]
        in_camera = np.einsum("nij,mj->nmi", R, s.points) + at.T[:, None, :3, 3]
        by_camera_point = problem.camera.projection_jacobian(in_camera)
        by_point = np.einsum("nmuk,nki->nmui", by_camera_point, R)
        by_target, by_camera = by_twist(by_point, s.points), by_twist(by_camera_point, in_camera)
        by_reading = np.einsum("nmut,nkt->nmuk", by_target, at.by_reading)
        projected = problem.camera.project(in_camera)
        target_by_free = np.swapaxes(at.by_unknown[:, problem.free, :3], 1, 2)
        return cls(s, projected, by_point, by_target, by_camera, by_reading, target_by_free)

    def by_size(self) -> Array:
        return np.asarray(np.einsum("nmui,mi->nmu", self.by_point, self.s.points)[..., None])

    def by_focal_length(self, problem: Problem) -> Array:
        return np.asarray((self.projected - problem.camera.K[:2, 2])[..., None])

    def by_skew(self) -> Array:
        back = np.zeros_like(self.s.readings)
        back[1:] = self.s.readings[:-1] - self.s.readings[1:]
        return np.asarray(np.einsum("nmuk,nk->nmu", self.by_reading, back)[..., None])

    def by_scale(self, j: int) -> Array:
        return np.asarray((self.by_reading[..., j] * self.s.readings[:, None, None, j])[..., None])


def find_error_hypotheses(
    problem: Problem, fit: ChainFit, noise_freedom: float = np.inf, readings: Sequence[str] = ()
) -> tuple[ChainErrorHypothesis, ...]:
    """Test all known model errors, the most significant first.

    Args:
        problem: of the fit.
        fit: without the errors.
        noise_freedom: measurements that the problem's `pixel_sigma` was estimated from.
        readings: their names, for a single chain; default: their numbers.
    """
    views = [
        _View.of(problem, s, fit.unknowns, e) for s, e in zip(problem.sightings, fit.errors, strict=True)
    ]
    columns = {
        "target size": [v.by_size() for v in views],
        "focal length": [v.by_focal_length(problem) for v in views],
        "time skew": [v.by_skew() for v in views],
    }
    single = len(views) == 1
    if single:
        count = views[0].s.readings.shape[1]
        called = readings or [f"reading {j}" for j in range(count)]
        columns |= {f"scale of {called[j]}": [views[0].by_scale(j)] for j in range(count)}
        columns |= {"target moved": [views[0].by_target], "camera moved": [views[0].by_camera]}
    together = [np.concatenate([of[v] for of in columns.values()], axis=-1) for v in range(len(views))]
    sums = _Sums(
        normal_equations(problem, fit, together),
        int(problem.free.sum()),
        noise_freedom,
        np.concatenate([v.target_by_free[w > 0.0] for v, w in zip(views, fit.weights, strict=True)]),
        _first_images(problem, fit),
    )
    found: list[ChainErrorHypothesis] = []
    place = sums.free
    for name, of in columns.items():
        chosen = slice(place, place + of[0].shape[-1])
        place = chosen.stop
        if "moved" in name:
            found += _moved(name, sums, chosen, fit)
        else:
            unit = "of the way from the last pose" if name == "time skew" else ""
            found.append(_test(name, unit, sums, chosen, 0, fit))
    return tuple(sorted(found, key=lambda suspect: -suspect.drop / suspect.limit))


class _Sums:
    """Normal equations of the free unknowns and of further ones that act from some stance on."""

    def __init__(
        self,
        equations: NormalEquations,
        free: int,
        noise_freedom: float,
        target_by_free: Array,
        first_images: list[int],
    ) -> None:
        self.free, self.noise_freedom = free, noise_freedom
        self.first_images, self._target_by_free = first_images, target_by_free
        self._S, self._g = equations.prior[0] + equations.S.sum(axis=0), equations.g.sum(axis=0)
        self._S_from = np.cumsum(equations.S[::-1, :, free:], axis=0)[::-1]
        self._g_from = np.cumsum(equations.g[::-1, free:], axis=0)[::-1]
        self._gradient = equations.prior[1] + self._g
        self.stances = len(equations.S)

    def score(self, chosen: slice, first: int) -> tuple[Array, Array, float, float, Array]:
        """Test unknowns that act from a stance on.

        Returns:
            Estimate and covariance, drop of the cost, rms shift of the targets by the other unknowns, and the change
            of these per unit of each tested one, (free, chosen).
        """
        n = self.free
        columns = slice(chosen.start - n, chosen.stop - n)
        S_fe, S_ee = self._S_from[first, :n, columns], self._S_from[first, chosen, columns]
        back = np.linalg.solve(self._scaled_S, self._scale[:, None] * S_fe) * self._scale[:, None]
        schur = S_ee - S_fe.T @ back
        rest = self._g_from[first, columns] - back.T @ self._gradient[:n]
        amount = solve_scaled(schur, rest)
        moves = self._target_by_free @ (back @ amount)
        rms = float(np.sqrt(np.mean(np.sum(moves**2, axis=1))))
        return amount, inverse_scaled(schur), float(rest @ amount), rms, back

    @cached_property
    def _scale(self) -> Array:
        return np.asarray(1.0 / np.sqrt(np.maximum(np.diag(self._S)[: self.free], 1e-300)))

    @cached_property
    def _scaled_S(self) -> Array:
        S: Array = self._S[: self.free, : self.free] * np.outer(self._scale, self._scale)
        return S + 1e-14 * np.eye(self.free)


def _test(
    name: str, unit: str, sums: _Sums, chosen: slice, first: int, fit: ChainFit, tries: int = 1
) -> ChainErrorHypothesis:
    amount, covariance, drop, moves, back = sums.score(chosen, first)
    k = len(amount)
    # excess scatter of the arm makes every error look significant; the part that the error explains is no scatter
    scatter = 1.0 + _ACROSS * max(0.0, fit.excess(sums.noise_freedom, drop, k) - 1.0)
    limit = largest_rise(SURE / tries, k, sums.noise_freedom) * scatter
    if k == 1:
        sigma = float(np.sqrt(covariance[0, 0]))
        return ChainErrorHypothesis(name, float(amount[0]), sigma, unit, drop, limit, moves, -1, back[:, 0])
    size, sigma = float(np.linalg.norm(amount[:3])), float(np.sqrt(np.trace(covariance[:3, :3])))
    return ChainErrorHypothesis(name, size, sigma, unit, drop, limit, size, sums.first_images[first])


def _moved(name: str, sums: _Sums, chosen: slice, fit: ChainFit) -> list[ChainErrorHypothesis]:
    """A single movement between two stances, at the most likely time."""
    times = range(1, sums.stances)
    tests = [_test(name, "m", sums, chosen, k, fit, len(times)) for k in times]
    return [max(tests, key=lambda test: test.drop)] if tests else []


def _first_images(problem: Problem, fit: ChainFit) -> list[int]:
    """First used image of every stance, in the order of chains and stances."""
    found: list[int] = []
    for s, w in zip(problem.sightings, fit.weights, strict=True):
        used = np.flatnonzero(w > 0.0)
        found += [int(used[i]) for i in np.unique(s.stances[used], return_index=True)[1]]
    return found


def sudden_change(wrong: npt.NDArray[np.bool_]) -> int | None:
    """Find the image at which correct images give way to wrong ones or vice versa; None if wrong ones are scattered.

    If two halves do not fit each other, one of them is rejected (likelihood ratio of two rates against one).
    """
    n = len(wrong)
    if n < 2 or not wrong.any():
        return None
    so_far, k = np.cumsum(wrong.astype(np.intp)), np.arange(1, n)
    before, total = so_far[:-1], so_far[-1:]
    gain = _log_likelihood(before, k) + _log_likelihood(total - before, n - k)
    drop = 2.0 * (gain - _log_likelihood(total, np.array([n])))
    best = int(np.argmax(drop))
    return best + 1 if drop[best] > stats.chi2.isf(SURE / n, 1) else None


def _log_likelihood(wrong: npt.NDArray[np.intp], of: npt.NDArray[np.intp]) -> Array:
    """Log likelihood of that many wrong images, at their own rate."""
    right = of - wrong
    return np.asarray(special.xlogy(wrong, wrong / of) + special.xlogy(right, right / of))
