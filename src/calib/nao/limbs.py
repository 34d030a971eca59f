"""Errors of a NAO's limb lengths: a score test that names them without a fit, and when they enter the model.

A leg has five: from the torso out and down to the hip, thigh, tibia, and from the ankle down to the board. Other
lengths are held at the data sheet: the neck and the camera's position in the head, which act as the same shift of both
hips, and offsets along the knee's axis and across thigh and tibia, which act as mounts and joint offsets do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.chain.fit import MOST_STEPS, ChainFit, Problem, normal_equations
from calib.chain.model_selection import MEANINGLESS, Trial, largest_rise
from calib.chain.score_tests import ChainErrorHypothesis, find_error_hypotheses
from calib.model.least_squares import inverse_scaled
from calib.model.score_test import score_test
from calib.nao.chain import LIMBS, SIDES, NaoUnknowns
from vision.camera.projection import Projection, along

LIMB_SIGMA = 0.5e-3  # m, prior of a limb's error (docs/sources.md, "The NAO and its paper")
_ASTRAY = 100.0  # chi2 per degree of freedom above which a fit that did not converge is given up
LIMB_NAMES = tuple(f"{side}{limb}_mm" for side in SIDES for limb in LIMBS)


@dataclass(frozen=True, eq=False)
class LimbTest:
    """Score test of all limbs together.

    Attributes:
        limbs: error of each one shown, with all others in the model, the most significant first.
        drop: of the cost, if the model included all.
        limit: drop that meaningless limbs exceed with probability `MEANINGLESS`.
    """

    limbs: tuple[ChainErrorHypothesis, ...]
    drop: float
    limit: float


def limb_unknowns(unknowns: NaoUnknowns, sides: Sequence[str]) -> list[int]:
    """Indices of the limbs of the legs `sides`, each L or R."""
    return [unknowns.names.index(n) for n in LIMB_NAMES if n[0] in sides]


def find_limb_errors(
    problem: Problem, fit: ChainFit, unknowns: NaoUnknowns, sides: Sequence[str]
) -> LimbTest:
    """Test the limbs in one linear step from a fit without them, in which all that was fitted may change.

    Args:
        problem: of the fit, with limbs among its unknowns but not free.
        fit: without limb errors.
        unknowns: of the problem.
        sides: legs of the images, L and R.
    """
    limbs = limb_unknowns(unknowns, sides)
    at = [s.evaluate(fit.unknowns, e) for s, e in zip(problem.sightings, fit.errors, strict=True)]
    columns = [
        along(Projection(problem.camera, a.T, s.points).by_target, a.by_unknown[:, limbs])
        for s, a in zip(problem.sightings, at, strict=True)
    ]
    equations, n = normal_equations(problem, fit, columns), int(problem.free.sum())
    S, g = equations.total
    S[n:, n:] += np.eye(len(limbs)) / LIMB_SIGMA**2
    test = score_test(inverse_scaled(S[:n, :n]), g[:n], S[:n, n:], S[n:, n:], g[n:])
    # excess cost of an incomplete model makes every limb look significant; what the limbs explain is not excess
    excess = max(1.0, fit.excess(problem.noise_freedom, test.drop, len(limbs)))
    one = largest_rise(MEANINGLESS / len(limbs), 1, problem.noise_freedom) * excess
    shifts = np.concatenate([a.by_unknown[w > 0.0, :, :3] for a, w in zip(at, fit.weights, strict=True)])
    net = shifts[:, limbs] + np.einsum("fl,ifk->ilk", test.others, shifts[:, problem.free])
    sigmas = np.sqrt(np.diag(test.covariance))
    found = [
        ChainErrorHypothesis(
            f"limb {unknowns.names[i].removesuffix('_mm')}",
            float(test.amount[k]),
            float(sigmas[k]),
            "m",
            float((test.amount[k] / sigmas[k]) ** 2),
            one,
            float(abs(test.amount[k]) * np.sqrt(np.mean(np.sum(net[:, k] ** 2, axis=1)))),
            -1,
            test.others[:, k],
        )
        for k, i in enumerate(limbs)
    ]
    limit = largest_rise(MEANINGLESS, len(limbs), problem.noise_freedom) * excess
    return LimbTest(tuple(sorted(found, key=lambda limb: -limb.drop)), test.drop, limit)


def is_astray(fit: ChainFit) -> bool:
    """Whether a fit did not converge, and is so far off that it says nothing."""
    return fit.iterations >= MOST_STEPS and fit.chi2_dof > _ASTRAY


def limb_trial(problem: Problem, fit: ChainFit, test: LimbTest, part: str) -> Trial:
    """Whether limbs explain more than chance, and than any other single cause, such as a wrong target size."""
    others = [s.drop for s in find_error_hypotheses(problem, fit) if "moved" not in s.name]
    return Trial(part, max(test.drop - max(others), 0.0), test.limit)
