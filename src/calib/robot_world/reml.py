"""Two unknown poses and the variance components from pairs of poses, by restricted maximum likelihood (REML).

For given noise sizes the poses follow in closed form (generalised least squares), as the residuals are nearly linear in
them. The sizes maximise the likelihood with the poses integrated out (H. D. Patterson and R. Thompson, "Recovery of
inter-block information when block sizes are unequal", 1971), which accounts for the twelve fitted parameters. Smooth
errors of the arm's geometry are unknowns too, with a prior whose size is also estimated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from scipy.special import gammaln

from arm.se3 import Array, Bools, frozen, moved
from calib.robot_world.noise_model import Covariances, Linearised, NoiseModel, skews

UNKNOWNS = 12
_ROUNDS = 12
_FTOL = 1e-4  # tolerance of the log likelihood, and of the log sizes
_DONE = 1e-3  # last step of the poses, standard deviations; ten times that for log sizes and weights


@dataclass(frozen=True, eq=False)
class Closed:
    """Closed loops: T_camera_target = inverse(P) M Q for every pair, with P and Q unknown and M from the arm.

    Attributes:
        T_base_gripper: (n, 4, 4).
        T_camera_target: (n, 4, 4).
        camera_in_gripper: if True, M is T_gripper_base, P T_gripper_camera and Q T_base_target; else M is
            T_base_gripper, P T_base_camera and Q T_gripper_target.
    """

    T_base_gripper: Array
    T_camera_target: Array
    camera_in_gripper: bool

    @property
    def M(self) -> Array:
        """Motion of the arm in the loop, (n, 4, 4)."""
        return inverses(self.T_base_gripper) if self.camera_in_gripper else self.T_base_gripper

    def linearised(self, P: Array, Q: Array) -> Linearised:
        """Linearise about P and Q, 4x4; a twist, translation first, changes P to P exp(twist)."""
        MQ = self.M @ Q
        predicted = inverses(P[None]) @ MQ
        R, t = predicted[:, :3, :3], predicted[:, :3, 3]
        back = R.transpose(0, 2, 1)
        turn = Rotation.from_matrix(back @ self.T_camera_target[:, :3, :3]).as_rotvec()
        residuals = np.concatenate([self.T_camera_target[:, :3, 3] - t, turn], axis=1)
        J = np.zeros((len(t), 6, UNKNOWNS))
        J[:, :3, :3], J[:, :3, 3:6], J[:, :3, 6:9] = -np.eye(3), skews(t), R
        J[:, 3:, 3:6], J[:, 3:, 9:] = -back, np.eye(3)
        G = np.zeros((len(t), 6, 6))
        if self.camera_in_gripper:
            G[:, :3, :3], G[:, :3, 3:] = -P[:3, :3].T, P[:3, :3].T @ skews(MQ[:, :3, 3])
            G[:, 3:, 3:] = -back @ P[:3, :3].T
        else:
            turned = P[:3, :3].T @ self.T_base_gripper[:, :3, :3]
            G[:, :3, :3], G[:, :3, 3:] = turned, -turned @ skews(Q[None, :3, 3])
            G[:, 3:, 3:] = Q[:3, :3].T
        return Linearised(residuals, J, G, predicted, self.T_base_gripper)


@dataclass(frozen=True, eq=False)
class PairFit:
    """Fitted poses and noise sizes.

    Attributes:
        P, Q: 4x4, see `Closed`.
        scatter: noise model that was fitted.
        sizes: logarithms of standard deviations (but target centres are not logarithms), named by `scatter.names`.
        weights: of every pair, (n,); all 1 unless the noise is Student's t.
        covariance: (12, 12) of the twists of P and Q.
        log_likelihood: with the poses integrated out.
        at: the pairs, linearised about P and Q.
        covariances: (n, 6, 6) of single pairs, without weights and without the arm's geometry.
    """

    P: Array
    Q: Array
    scatter: NoiseModel
    sizes: Array
    weights: Array
    covariance: Array
    log_likelihood: float
    at: Linearised
    covariances: Array

    @property
    def size(self) -> dict[str, float]:
        """Standard deviations in m and rad, and half the target's size in m, by name."""
        return {
            name: float(s if name.startswith("middle") else np.exp(s))
            for name, s in zip(self.scatter.names, self.sizes, strict=True)
        }


def fit_pairs(
    closed: Closed, P: Array, Q: Array, scatter: NoiseModel, used: Bools, like: PairFit | None = None
) -> PairFit:
    """Fit poses and noise sizes by maximum likelihood.

    Args:
        closed: pairs.
        P, Q: start, 4x4.
        scatter: noise model.
        used: (n, 2) whether translation and rotation of a pair are used.
        like: a fit whose sizes are the start for those of the same name.
    """
    rows = np.repeat(used, 3, axis=1)
    weights = np.ones(len(rows))
    sizes: Array | None = None
    for _ in range(_ROUNDS):
        likelihood = _Likelihood(Covariances(scatter, closed.linearised(P, Q)), rows, weights)
        before = _start(likelihood.covariances, like) if sizes is None else sizes
        bounds = likelihood.covariances.prior()[:, 2:]
        result = minimize(
            likelihood, before, jac=True, method="TNC", bounds=bounds, options={"ftol": _FTOL, "xtol": _FTOL}
        )
        after: Array = np.asarray(result.x)
        solved = likelihood.solve(after)
        P, Q = moved(P, solved.step[:6]), moved(Q, solved.step[6:UNKNOWNS])
        then = weights
        if scatter.freedom is not None:
            then = (scatter.freedom + rows.sum(axis=1)) / (scatter.freedom + solved.squares)
        small = np.abs(solved.step[:UNKNOWNS] / np.sqrt(np.diag(solved.inverse)[:UNKNOWNS])).max() < _DONE
        still = np.abs(after - before).max() < 10.0 * _DONE and np.abs(then - weights).max() < 10.0 * _DONE
        sizes = after
        if small and still:
            break
        weights = then
    at = closed.linearised(P, Q)
    likelihood = _Likelihood(Covariances(scatter, at), rows, weights)
    solved = likelihood.solve(after)
    covariance = solved.inverse[:UNKNOWNS, :UNKNOWNS]
    return PairFit(
        frozen(P),
        frozen(Q),
        scatter,
        frozen(after),
        frozen(weights),
        frozen(covariance),
        likelihood.of(solved),
        at,
        likelihood.covariances(after)[0],
    )


def _start(covariances: Covariances, like: PairFit | None) -> Array:
    sizes = covariances.prior()[:, 0]
    known = dict(zip(like.scatter.names, like.sizes, strict=True)) if like is not None else {}
    return np.array([known.get(n, s) for n, s in zip(covariances.scatter.names, sizes, strict=True)])


@dataclass(frozen=True, eq=False)
class _Solved:
    """The solution for given sizes: step (12 + effects,), inverse information, and residuals after the step."""

    step: Array
    inverse: Array
    left: Array  # (n, 6)
    W: Array  # (n, 6, 6) inverse covariances, zero in rows that are not used
    derivatives: Array
    log_determinant: float
    squares: Array  # (n,) squared Mahalanobis norm of `left`, without weights
    priors: Array  # (effects,) precisions


@dataclass(frozen=True, eq=False)
class _Likelihood:
    covariances: Covariances
    rows: Bools  # (n, 6)
    weights: Array  # (n,)

    def __call__(self, sizes: Array) -> tuple[float, Array]:
        """Cost and gradient: negative log likelihood, with a weak prior on the sizes."""
        s = self.solve(sizes)
        Wr = np.einsum("nij,nj->ni", s.W, s.left)
        WF = s.W @ self._design
        by_covariance = s.W - WF @ s.inverse @ WF.transpose(0, 2, 1) - Wr[:, :, None] * Wr[:, None, :]
        gradient = np.zeros(len(sizes))
        gradient[: len(s.derivatives)] = 0.5 * np.einsum("nij,knij->k", by_covariance, s.derivatives)
        if len(s.priors):
            half = len(s.priors) // 2
            effects = UNKNOWNS + np.arange(2 * half).reshape(2, half)
            variances = np.diag(s.inverse)
            for k, group in enumerate(effects):
                share = s.priors[k * half] * (variances[group] + s.step[group] ** 2)
                gradient[len(s.derivatives) + k] = float(half - share.sum())
        mean, sd = self.covariances.prior()[:, :2].T
        off = (sizes - mean) / sd
        value = 0.5 * s.log_determinant + 0.5 * float((Wr * s.left).sum()) + 0.5 * float(off @ off)
        value += 0.5 * float((s.priors * s.step[UNKNOWNS:] ** 2).sum())
        return value, gradient + off / sd

    @property
    def _design(self) -> Array:
        return np.concatenate([self.covariances.at.by_unknowns, self.covariances.smooth], axis=2)

    def solve(self, sizes: Array) -> _Solved:
        """Solve for the unknowns, given sizes."""
        S, derivatives = self.covariances(sizes)
        both = self.rows[:, :, None] & self.rows[:, None, :]
        S = np.where(both, S, np.eye(6))
        W = np.where(both, np.linalg.inv(S), 0.0)
        log_determinant = float(
            np.linalg.slogdet(S)[1].sum() - (self.rows.sum(axis=1) * np.log(self.weights)).sum()
        )
        alone = W
        W = W * self.weights[:, None, None]
        F = self._design
        half = self.covariances.smooth.shape[2] // 2
        priors = np.repeat(np.exp(-2.0 * sizes[len(derivatives) :]), half)
        WF = W @ F
        # pair by pair: one large product would start BLAS's threads, which takes a hundred times longer here
        information = (WF.transpose(0, 2, 1) @ F).sum(axis=0)
        information[UNKNOWNS:, UNKNOWNS:] += np.diag(priors)
        scale = 1.0 / np.sqrt(np.diag(information))
        inverse = scale[:, None] * np.linalg.inv(scale[:, None] * information * scale) * scale
        residuals = self.covariances.at.residuals
        step = inverse @ np.einsum("nia,ni->a", WF, residuals)
        left = residuals - F @ step
        log_determinant += float(np.linalg.slogdet(information)[1]) - float(np.log(priors).sum())
        return _Solved(
            step,
            inverse,
            left,
            W,
            np.where(both, derivatives / self.weights[:, None, None], 0.0),
            log_determinant,
            np.einsum("ni,nij,nj->n", left, alone, left),
            priors,
        )

    def of(self, s: _Solved) -> float:
        """Log likelihood of the residuals under the noise model's own distribution."""
        m = self.rows.sum(axis=1)
        freedom = self.covariances.scatter.freedom
        fitted = 0.5 * s.log_determinant + 0.5 * float((s.priors * s.step[UNKNOWNS:] ** 2).sum())
        if freedom is None:
            return -fitted - 0.5 * float(s.squares.sum()) - 0.5 * float(m.sum()) * float(np.log(2.0 * np.pi))
        fitted += 0.5 * float((m * np.log(self.weights)).sum())  # the t distribution has no weights
        law = (
            gammaln((freedom + m) / 2.0)
            - gammaln(freedom / 2.0)
            - 0.5 * m * np.log(freedom * np.pi)
            - 0.5 * (freedom + m) * np.log1p(s.squares / freedom)
        )
        return float(law.sum()) - fitted


def inverses(T: Array) -> Array:
    """Inverses of rigid transforms (n, 4, 4)."""
    back = np.zeros_like(T)
    back[:, :3, :3] = T[:, :3, :3].transpose(0, 2, 1)
    back[:, :3, 3] = -np.einsum("nij,nj->ni", back[:, :3, :3], T[:, :3, 3])
    back[:, 3, 3] = 1.0
    return back
