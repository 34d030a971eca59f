"""Joint compliance (springs) and backlash (play) of the NAO's legs, of which stances determine little.

Backlash affects images only if the joint's torque changes sign, compliance only if the torque differs between stances.
All that is known about the other joints is that joints of one make are alike. So all compliances come from one
distribution, and all half backlashes from another. Their means and widths come from the well determined joints.

Backlash may change sides smoothly with the torque, or abruptly. In the second case a joint with a torque near zero may
lie on either side, because masses are uncertain. Then the side is chosen stance by stance to minimise the cost,
including the log probability that the torque has that sign. The shape with the lower cost is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.special import log_ndtr

from arm.se3 import Array, Indices
from calib.chain.fit import ChainFit, Problem, Sightings, fit_chains, whitened
from calib.nao.chain import LEG, KnownSides, NaoUnknowns, gravity_gains, gravity_torques, nao_model
from vision.camera.projection import along

MASS_SIGMA = 0.10  # relative standard deviation of a link's mass
_LEAST_TORQUE_SIGMA = 0.005  # Nm; centres of mass are inexact too
_KINDS = ("compliance", "backlash")
_FIRST_MEAN, _FIRST_SIGMA = np.radians(0.5), np.radians(1.0)  # first prior; per Nm for compliances
_KNOWN = np.radians(0.15)  # largest standard deviation of a well determined joint
_FEWEST_KNOWN, _LEAST_WIDTH = 4, np.radians(0.13)
# largest torque of a doubtful side, in sigmas; most doubtful sides per stance
_DOUBTFUL, _MOST_DOUBTFUL = 3.5, 5
_ROUNDS = 10


@dataclass(frozen=True, eq=False)
class BacklashFit:
    """A fit with compliance and backlash.

    Attributes:
        problem: with the priors and gains used.
        fit: of it.
        hard: whether backlash changes sides abruptly.
        smooth_cost, hard_cost: of both shapes, the second including the log probability of the sides.
        iterations: of all fits.
    """

    problem: Problem
    fit: ChainFit
    hard: bool
    smooth_cost: float
    hard_cost: float
    iterations: int


def torque_sigmas(side: str, legs: Array, gravity: npt.ArrayLike) -> Array:
    """Standard deviation (n, 6) Nm of gravity torques if every link's mass is known to `MASS_SIGMA`."""
    full = nao_model()
    total = np.zeros((len(legs), len(LEG)))
    for joint in LEG:
        alone = full.copy()
        for i in range(1, alone.njoints):
            if alone.names[i] != side + joint:
                alone.inertias[i] = pin.Inertia.Zero()
        total += (MASS_SIGMA * gravity_torques(side, legs, gravity, alone)) ** 2
    return np.asarray(np.sqrt(total + _LEAST_TORQUE_SIGMA**2))


def with_first_priors(problem: Problem, unknowns: NaoUnknowns) -> Problem:
    """Set wide priors on compliance and backlash: mean 0.5 deg, standard deviation 1 deg."""
    start, sigma = problem.start.copy(), problem.prior_sigma.copy()
    for kind in _KINDS:
        places = _fitted(problem, unknowns, kind)
        start[places], sigma[places] = _FIRST_MEAN, _FIRST_SIGMA
    return replace(problem, start=start, prior_sigma=sigma)


def with_priors_of_a_make(problem: Problem, unknowns: NaoUnknowns, fit: ChainFit) -> Problem:
    """Set priors on compliance and backlash from the mean and spread of the well determined ones in a fit."""
    start, sigma = problem.start.copy(), problem.prior_sigma.copy()
    spread = np.sqrt(np.diag(fit.covariance(problem.free)))
    for kind in _KINDS:
        places = _fitted(problem, unknowns, kind)
        known = [i for i in places if spread[i] < _KNOWN]
        if len(known) < _FEWEST_KNOWN:
            continue
        weight = 1.0 / (spread[known] ** 2 + _KNOWN**2)
        mean = float(weight @ fit.unknowns[known] / weight.sum())
        width = float(np.sqrt(weight @ (fit.unknowns[known] - mean) ** 2 / weight.sum()))
        start[places], sigma[places] = mean, max(1.3 * width, _LEAST_WIDTH)
    return replace(problem, start=start, prior_sigma=sigma)


def fit_compliance_and_backlash(
    problem: Problem,
    unknowns: NaoUnknowns,
    sides: Sequence[str],
    gravity: npt.ArrayLike,
    weights: Sequence[Array] | None = None,
) -> BacklashFit:
    """Fit with priors common to the joints, and with the shape of backlash that costs less.

    Args:
        problem: with sightings from `calib.nao.chain.nao_sightings`; its free unknowns are kept.
        unknowns: of the problem.
        sides: L or R of each of the problem's chains.
        gravity: in the torso frame, (3,) m/s^2.
        weights: of every image of every chain, 0 for wrong ones; default: 1.
    """
    first = with_first_priors(problem, unknowns)
    begin = fit_chains(first, weights)
    known = with_priors_of_a_make(first, unknowns, begin)
    # not from `begin`, as that would converge slowly: torque derivatives are neglected
    smooth = fit_chains(known, weights)
    iterations = begin.iterations + smooth.iterations
    if not _fitted(problem, unknowns, "backlash"):
        return BacklashFit(known, smooth, False, smooth.cost, float("inf"), iterations)
    hard, hard_fit, improbable, steps = _fit_abrupt(
        known, unknowns, sides, np.asarray(gravity, float), smooth
    )
    cost, iterations = hard_fit.cost + improbable, iterations + steps
    if cost < smooth.cost:
        return BacklashFit(hard, hard_fit, True, smooth.cost, cost, iterations)
    return BacklashFit(known, smooth, False, smooth.cost, cost, iterations)


def _fitted(problem: Problem, unknowns: NaoUnknowns, kind: str) -> list[int]:
    return [i for i, name in enumerate(unknowns.names) if kind in name and problem.free[i]]


def _fit_abrupt(
    problem: Problem, unknowns: NaoUnknowns, sides: Sequence[str], gravity: Array, begin: ChainFit
) -> tuple[Problem, ChainFit, float, int]:
    """Fit with the cheapest sides of the backlash; return also -2 log probability of the sides, and all steps."""
    chains = list(zip(problem.sightings, sides, strict=True))
    torque = [_torque(s, side, unknowns, gravity, begin) for s, side in chains]
    sigma = [torque_sigmas(side, s.readings[:, :6], gravity) for s, side in chains]
    signs = [np.where(t < 0.0, -1.0, 1.0) for t in torque]
    fit, steps = begin, 0
    for number in range(_ROUNDS):
        held = [
            replace(s, gains=gravity_gains(side, unknowns, gravity, KnownSides(s.readings[:, :6], lie)))
            for s, side, lie in zip(problem.sightings, sides, signs, strict=True)
        ]
        problem = replace(problem, sightings=held)
        fit = fit_chains(problem, begin.weights)
        steps += fit.iterations
        if number == 1:
            problem = with_priors_of_a_make(problem, unknowns, fit)
        torque = [_torque(s, side, unknowns, gravity, fit) for s, side in zip(held, sides, strict=True)]
        then = [
            _likelier_sides(
                problem, fit, k, fit.unknowns[_indices(unknowns, side, "backlash_half_deg")], lie, t / w
            )
            for k, (side, lie, t, w) in enumerate(zip(sides, signs, torque, sigma, strict=True))
        ]
        same = all(np.array_equal(a, b) for a, b in zip(then, signs, strict=True))
        signs = then
        if same and number > 1:
            break
    improbable = 0.0
    for s, lie, t, w in zip(problem.sightings, signs, torque, sigma, strict=True):
        _, once = np.unique(s.stances, return_index=True)
        improbable -= 2.0 * float(log_ndtr((lie * t / w)[once]).sum())
    return problem, fit, improbable, steps


def _torque(s: Sightings, side: str, unknowns: NaoUnknowns, gravity: Array, fit: ChainFit) -> Array:
    offsets = fit.unknowns[_indices(unknowns, side, "deg")]
    return gravity_torques(side, s.readings[:, :6] + offsets, gravity)


def _indices(unknowns: NaoUnknowns, side: str, kind: str) -> list[int]:
    """Indices of the unknowns of a kind, such as "deg", of a leg's joints."""
    return [unknowns.names.index(f"{side}{joint}_{kind}") for joint in LEG]


def _likelier_sides(
    problem: Problem, fit: ChainFit, chain: int, half: Array, signs: Array, score: Array
) -> Array:
    """Cheapest sides (n, 6) of one chain, stance by stance, with unknowns fixed and reading errors refitted.

    Args:
        problem, fit: with backlash on the sides `signs`.
        chain: its number.
        half: its half backlashes (6,) rad.
        signs: current sides, (n, 6).
        score: torques in their standard deviations, (n, 6).
    """
    s, errors, weights = problem.sightings[chain], fit.errors[chain], fit.weights[chain]
    at_fit, used = s.evaluate(fit.unknowns, errors), weights > 0.0
    r, by_target, _ = whitened(problem, s, at_fit, weights, fit.unknowns)
    by_reading = along(by_target, at_fit.by_reading)
    then = signs.copy()
    for stance in np.unique(s.stances[used]):
        images = np.flatnonzero((s.stances == stance) & used)
        at = images[0]
        order = np.argsort(np.abs(score[at]))
        doubtful = [j for j in order if abs(score[at, j]) < _DOUBTFUL][:_MOST_DOUBTFUL]
        if not doubtful:
            continue
        N, now, sigma = _columns(problem, s, by_reading, errors, images)
        rows = r[images].reshape(-1)
        solve = np.linalg.inv(N.T @ N + np.diag(sigma**-2))
        least = np.inf
        for tried in product((-1.0, 1.0), repeat=len(doubtful)):
            lie = signs[at].copy()
            lie[doubtful] = tried
            moved = rows - N[:, :6] @ (half * (lie - signs[at]))
            g = N.T @ moved - now / sigma**2
            cost = float(moved @ moved + ((now / sigma) ** 2).sum() - g @ solve @ g)
            cost -= 2.0 * float(log_ndtr(lie[doubtful] * score[at, doubtful]).sum())
            if cost < least - 1e-9:
                least, best = cost, lie
        then[s.stances == stance] = best
    return then


def _columns(
    problem: Problem, s: Sightings, by_reading: Array, errors: Array, images: Indices
) -> tuple[Array, Array, Array]:
    """Derivatives of all rows by the readings of a stance (the leg's six first), errors, and standard deviations.

    An exact reading gets a negligible error.
    """
    k, m = len(images), by_reading.shape[1]
    sigma = np.maximum(problem.reading_sigma, 1e-9)
    head = by_reading.shape[-1] - 6
    N = np.zeros((k, m, 2, 6 + head * k))
    N[..., :6] = by_reading[images][..., :6]
    for i, image in enumerate(images):
        N[i, ..., 6 + head * i : 6 + head * (i + 1)] = by_reading[image, ..., 6:]
    now = np.concatenate([errors[images[0], :6], errors[images, 6:].reshape(-1)])
    return N.reshape(k * m * 2, -1), now, np.concatenate([sigma[:6], np.tile(sigma[6:], k)])
