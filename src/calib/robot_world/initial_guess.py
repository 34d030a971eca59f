"""Where a camera stands and where its target is held, from pairs of poses of which some may be wrong: a start.

A closed form (M. Shah, "Solving the robot-world/hand-eye calibration problem using the Kronecker product", 2013) is
ruined by one wrong pose in twenty (fact sheet of calibration, section 1). So it is tried on many small sets of pairs,
and the poses that agree with the best of them are found without knowing how well an arm and a camera should agree: an
arm with wrong zeros scatters by millimetres, a good one by a tenth of that.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.stats import chi

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen, transform

Bools = npt.NDArray[np.bool_]

FEWEST = 3  # pairs: two motions about different axes
_SETS, _SET = 500, 3
_POLISHED = 8  # of the best sets
_ROUNDS = 12
_AGREE = 0.4  # share of the pairs that the score looks at: fewer than are right
_TRUSTED = 6.0  # standard deviations that a right pose may be off: wrong zeros leave no bell curve
SCATTER = 0.15  # rad about each axis; pairs that are taken at random agree to half a turn
_EXACT = 1e-9  # m and rad: poses this near agree, however much nearer others are


class RobotWorldStart(NamedTuple):
    """A start of robot-world calibration.

    Attributes:
        T_base_camera: 4x4.
        T_gripper_target: 4x4.
        inliers: (n,) which pairs agree with it.
    """

    T_base_camera: Array
    T_gripper_target: Array
    inliers: Bools


def start_robot_world(T_base_gripper: Array, T_camera_target: Array, seed: int = 0) -> RobotWorldStart:
    """Pose of a standing camera and of the target in the gripper, from pairs of which up to half may be wrong.

    For a camera in the gripper and a standing target give the inverses of T_camera_target; then what is called camera
    here is the target.

    Args:
        T_base_gripper: (n, 4, 4), from the arm.
        T_camera_target: (n, 4, 4), from the camera.
        seed: of the sets that are tried.

    Raises:
        CalibrationRefused: fewer than three pairs, none of the sets determines the poses, or no pairs agree.
    """
    A, B = np.asarray(T_base_gripper, dtype=float), np.asarray(T_camera_target, dtype=float)
    if len(A) < FEWEST:
        raise CalibrationRefused(
            f"{len(A)} pairs of poses do not determine where the camera stands: at least {FEWEST}, with turns about "
            "different axes, and 12 to be exact",
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
    # of few pairs some three always agree best: all of them are tried too
    best.append(RobotWorldStart(frozen(Y[0]), frozen(X[0]), np.isfinite(turn[0] + shift[0])))
    found = max(best, key=lambda one: _likelihood(A, B, one))
    turn, _ = residual_sizes(A, B, found.T_gripper_target, found.T_base_camera)
    scatter = float(np.sqrt((turn[found.inliers] ** 2).mean() / 3.0)) if found.inliers.any() else np.inf
    if not scatter < SCATTER:
        raise CalibrationRefused(
            f"no {max(FEWEST, k + 1)} of {len(A)} pairs of poses agree with each other to {np.degrees(SCATTER):.0f} "
            "deg: were arm and camera read at the same time, and do target and camera stay where they are fixed?",
            reason="no_consensus",
            pairs=len(A),
            scatter_rad=scatter,
        )
    return found


def closed_form(A: Array, B: Array) -> tuple[Array, Array]:
    """X and Y, 4x4, with A X = Y B for all pairs (n, 4, 4), by OpenCV's SHAH; NaN if it finds none.

    OpenCV asks for `world2cam` and `base2gripper` and solves world2cam base2world = gripper2cam base2gripper: that is
    A X = Y B with A and B in these two places, so nothing needs to be inverted.
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
    found = [closed_form(A, B)]  # right at once if all pairs are
    if len(A) > FEWEST:
        sets = random.random((_SETS, len(A))).argpartition(_SET - 1, axis=1)[:, :_SET]
        found += [closed_form(A[chosen], B[chosen]) for chosen in sets]
    whole = [pair for pair in found if np.isfinite(pair[0]).all()]
    if not whole:
        raise CalibrationRefused(
            "no three pairs of poses determine where the camera stands: the arm must turn about different axes",
            reason="degenerate",
            pairs=len(A),
        )
    return np.array([X for X, _ in whole]), np.array([Y for _, Y in whole])


def _polished(A: Array, B: Array, X: Array, Y: Array) -> RobotWorldStart:
    """The closed form on what agrees, again and again until that no longer changes."""
    n = len(A)
    inliers: Bools = np.zeros(n, dtype=bool)
    share = _AGREE
    for _ in range(_ROUNDS):
        sizes = residual_sizes(A, B, X, Y)
        k = max(FEWEST, int(np.ceil(share * n))) - 1
        fitted = _fitted(FEWEST if not inliers.any() else int(inliers.sum()))
        scales = [np.partition(s, k)[k] / chi.ppf(_AGREE, 3) * fitted + _EXACT for s in sizes]
        now: Bools = np.logical_and.reduce([s < _TRUSTED * c for s, c in zip(sizes, scales, strict=True)])
        if now.sum() < FEWEST:
            break
        share = _AGREE * float(now.mean())  # the same quantile of those that are right
        same = bool((now == inliers).all())
        inliers = now
        if same:
            break
        again = closed_form(A[inliers], B[inliers])
        if not np.isfinite(again[0]).all():
            break
        X, Y = again
    return RobotWorldStart(frozen(Y), frozen(X), inliers)


def _likelihood(A: Array, B: Array, found: RobotWorldStart) -> float:
    """Of right pairs that scatter as they do, and of wrong ones anywhere within a turn and a metre."""
    m = int(found.inliers.sum())
    if m < FEWEST:
        return -np.inf
    sizes = residual_sizes(A, B, found.T_gripper_target, found.T_base_camera)
    scales = [float(np.sqrt((s[found.inliers] ** 2).mean() / 3.0)) * _fitted(m) + _EXACT for s in sizes]
    return -3.0 * m * float(np.log(scales).sum())


def _fitted(m: int) -> float:
    """How much more m pairs scatter than their residuals after the fit: six unknowns turn, six shift."""
    return float(np.sqrt(3.0 * m / (3.0 * m - 6.0)))
