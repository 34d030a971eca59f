"""Robust initial guess for robot-world/hand-eye calibration, from pairs of poses with outliers.

One wrong pose in twenty ruins a closed form (M. Shah, "Solving the robot-world/hand-eye calibration problem using the
Kronecker product", 2013; docs/sources.md, "Pose pairs"). So the closed form is applied to many small random sets of
pairs, and the inliers of the best result are kept. The inlier threshold is estimated too, because an arm with wrong
joint offsets scatters by millimetres, a good one by a tenth of that.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array, Bools, frozen, transform
from calib.model.chi_square import chi2_quantile

FEWEST = 3  # pairs: two motions about different axes
_SETS, _SET = 500, 3
_POLISHED = 8  # number of best sets that are refined
_ROUNDS = 12
_AGREE = 0.4  # quantile of the pairs used as score; must be below the fraction of inliers
_LENGTH = np.sqrt(chi2_quantile(_AGREE, 3))  # the same quantile of the length of a normal 3-vector
_TRUSTED = 6.0  # inlier limit, standard deviations; wrong joint offsets give errors that are not normal
SCATTER = 0.15  # rad about each axis, limit for consensus; random pairs differ by up to half a revolution
_EXACT = 1e-9  # m and rad: added to all scales, so that poses this close always agree


class InitialGuess(NamedTuple):
    """Initial guess of robot-world calibration.

    Attributes:
        T_base_camera: 4x4.
        T_gripper_target: 4x4.
        inliers: (n,) pairs that agree with it.
    """

    T_base_camera: Array
    T_gripper_target: Array
    inliers: Bools


def initial_guess(T_base_gripper: Array, T_camera_target: Array, seed: int = 0) -> InitialGuess:
    """Estimate the poses of a fixed camera and of the target in the gripper; up to half the pairs may be wrong.

    For a camera in the gripper and a fixed target, pass the inverses of T_camera_target; camera and target then swap
    their roles in the result.

    Args:
        T_base_gripper: (n, 4, 4), from the arm.
        T_camera_target: (n, 4, 4), from the camera.
        seed: of the random sets.

    Raises:
        CalibrationRefused: fewer than three pairs, no set determines the poses, or no pairs agree.
    """
    A, B = np.asarray(T_base_gripper, dtype=float), np.asarray(T_camera_target, dtype=float)
    if len(A) < FEWEST:
        raise CalibrationRefused(
            f"{len(A)} pairs of poses do not determine the camera's extrinsics: at least {FEWEST} are needed, with "
            "rotations about different axes, and 12 for accuracy",
            reason="few_pairs",
            pairs=len(A),
            fewest=FEWEST,
        )
    X, Y = _hypotheses(A, B, np.random.default_rng(seed))
    turn, shift = residual_sizes(A, B, X, Y)
    k = max(FEWEST, int(np.ceil(_AGREE * len(A)))) - 1
    spread = np.log(np.partition(turn, k, axis=-1)[:, k] + _EXACT)
    spread += np.log(np.partition(shift, k, axis=-1)[:, k] + _EXACT)
    best = [_polished(A, B, X[i], Y[i]) for i in np.argsort(spread)[:_POLISHED]]
    # if there are few pairs, some three of them always agree best, so the set of all pairs competes too
    best.append(InitialGuess(frozen(Y[0]), frozen(X[0]), np.isfinite(turn[0] + shift[0])))
    found = max(best, key=lambda one: _likelihood(A, B, one))
    turn, _ = residual_sizes(A, B, found.T_gripper_target, found.T_base_camera)
    scatter = float(np.sqrt((turn[found.inliers] ** 2).mean() / 3.0)) if found.inliers.any() else np.inf
    if not scatter < SCATTER:
        raise CalibrationRefused(
            f"no {max(FEWEST, k + 1)} of {len(A)} pairs of poses agree with each other to {np.degrees(SCATTER):.0f} "
            "deg: were arm and camera read at the same time, and are target and camera fixed?",
            reason="no_consensus",
            pairs=len(A),
            scatter_rad=scatter,
        )
    return found


def closed_form(A: Array, B: Array) -> tuple[Array, Array]:
    """X and Y, 4x4, with A X = Y B for all pairs (n, 4, 4), by OpenCV's SHAH method; NaN if it fails.

    OpenCV solves world2cam base2world = gripper2cam base2gripper. This is A X = Y B with A passed as `world2cam` and B
    as `base2gripper`, so nothing has to be inverted.
    """
    nothing = np.full((4, 4), np.nan)
    try:
        R_x, t_x, R_y, t_y = cv2.calibrateRobotWorldHandEye(
            R_world2cam=list(A[:, :3, :3]),
            t_world2cam=list(A[:, :3, 3]),
            R_base2gripper=list(B[:, :3, :3]),
            t_base2gripper=list(B[:, :3, 3]),
            method=cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
        )
    except cv2.error:  # a singular system
        return nothing, nothing
    X, Y = transform(R_x, np.reshape(t_x, 3)), transform(R_y, np.reshape(t_y, 3))
    if not (np.isfinite(X).all() and np.isfinite(Y).all()):
        return nothing, nothing
    return X, Y


def residual_sizes(A: Array, B: Array, X: Array, Y: Array) -> tuple[Array, Array]:
    """Angles in rad and distances in m between A X and Y B, (..., n), for X and Y (..., 4, 4)."""
    AX = A @ X[..., None, :, :]
    YB = Y[..., None, :, :] @ B
    chord = np.linalg.norm(AX[..., :3, :3] - YB[..., :3, :3], axis=(-2, -1)) / np.sqrt(8.0)
    return 2.0 * np.arcsin(np.minimum(chord, 1.0)), np.linalg.norm(AX[..., :3, 3] - YB[..., :3, 3], axis=-1)


def _hypotheses(A: Array, B: Array, random: np.random.Generator) -> tuple[Array, Array]:
    found = [closed_form(A, B)]  # the best hypothesis if there are no outliers
    if len(A) > FEWEST:
        sets = random.random((_SETS, len(A))).argpartition(_SET - 1, axis=1)[:, :_SET]
        found += [closed_form(A[chosen], B[chosen]) for chosen in sets]
    whole = [pair for pair in found if np.isfinite(pair[0]).all()]
    if not whole:
        raise CalibrationRefused(
            "no three pairs of poses determine the camera's extrinsics: the arm must rotate about different axes",
            reason="degenerate",
            pairs=len(A),
        )
    return np.array([X for X, _ in whole]), np.array([Y for _, Y in whole])


def _polished(A: Array, B: Array, X: Array, Y: Array) -> InitialGuess:
    """Refit the closed form to the inliers until they no longer change."""
    n = len(A)
    inliers: Bools = np.zeros(n, dtype=bool)
    share = _AGREE
    for _ in range(_ROUNDS):
        sizes = residual_sizes(A, B, X, Y)
        k = max(FEWEST, int(np.ceil(share * n))) - 1
        fitted = _fitted(FEWEST if not inliers.any() else int(inliers.sum()))
        scales = [np.partition(s, k)[k] / _LENGTH * fitted + _EXACT for s in sizes]
        now: Bools = np.logical_and.reduce([s < _TRUSTED * c for s, c in zip(sizes, scales, strict=True)])
        if now.sum() < FEWEST:
            break
        share = _AGREE * float(now.mean())  # the same quantile of the inliers
        same = bool((now == inliers).all())
        inliers = now
        if same:
            break
        again = closed_form(A[inliers], B[inliers])
        if not np.isfinite(again[0]).all():
            break
        X, Y = again
    return InitialGuess(frozen(Y), frozen(X), inliers)


def _likelihood(A: Array, B: Array, found: InitialGuess) -> float:
    """Log likelihood: normal inliers, and outliers anywhere within a revolution and a metre."""
    m = int(found.inliers.sum())
    if m < FEWEST:
        return -np.inf
    sizes = residual_sizes(A, B, found.T_gripper_target, found.T_base_camera)
    scales = [float(np.sqrt((s[found.inliers] ** 2).mean() / 3.0)) * _fitted(m) + _EXACT for s in sizes]
    return -3.0 * m * float(np.log(scales).sum())


def _fitted(m: int) -> float:
    """Ratio of the noise of m pairs to the rms of their residuals: six unknowns rotate, six translate."""
    return float(np.sqrt(3.0 * m / (3.0 * m - 6.0)))
