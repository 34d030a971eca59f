"""Robot-world/hand-eye calibration (AX = ZB): poses of camera and target from pairs of poses of arm and camera.

A consensus of pairs gives an initial guess and the outliers (`calib.robot_world.initial_guess`). The scatter of the
inliers gives their weights (`calib.robot_world.noise_model`). If only the rotation of a pair is wrong, as from a
flipped marker, its translation is still used.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from arm.errors import CalibrationRefused, InputError
from arm.se3 import Array, Bools, frozen
from calib.model.chi_square import chi2_limit
from calib.robot_world.initial_guess import initial_guess
from calib.robot_world.noise_model import NoiseModel
from calib.robot_world.observability import MotionAxes, refuse_parallel_axes
from calib.robot_world.reml import UNKNOWNS, Closed, PairFit, fit_pairs, inverses

FEWEST = 4  # pairs that agree; three determine the poses but not their error
CONSENSUS = 0.4  # fraction of the pairs that must agree
_WRONG = 1e-5  # false alarm rate of the outlier test
_STRAYS = 5.0  # degrees of freedom of Student's t
_GAIN = 2.0  # smallest gain in log likelihood that justifies one or two more sizes (Akaike)
_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class PosePairs:
    """Poses from arm and camera at the same times.

    Attributes:
        T_base_gripper: (n, 4, 4).
        T_camera_target: (n, 4, 4), NaN where the target was not detected.
        camera_in_gripper: True if the gripper holds the camera and the target is fixed; False for the reverse.
    """

    T_base_gripper: Array
    T_camera_target: Array
    camera_in_gripper: bool = False

    def __post_init__(self) -> None:
        shapes = self.T_base_gripper.shape, self.T_camera_target.shape
        if shapes[0] != shapes[1] or shapes[0][1:] != (4, 4):
            why = f"pairs of poses must be two arrays (n, 4, 4), got {shapes[0]} and {shapes[1]}"
            raise InputError(why, T_base_gripper=list(shapes[0]), T_camera_target=list(shapes[1]))

    @property
    def names(self) -> tuple[str, str]:
        """Names of the estimated poses: of the held object, then of the fixed one."""
        if self.camera_in_gripper:
            return "T_gripper_camera", "T_base_target"
        return "T_gripper_target", "T_base_camera"


@dataclass(frozen=True, eq=False)
class RobotWorld:
    """Calibration from pairs of poses.

    Attributes:
        pairs: the input.
        T_held: of the target (or camera) in the gripper, 4x4.
        T_standing: of the camera (or target) in the base, 4x4.
        covariance: (12, 12) of the twists of both, held first, in their own frames, translation first.
        used: (n, 2) whether translation and rotation of a pair were used.
        scatter: selected noise model.
        sizes: standard deviations of its components in m and rad, by name.
        reason: why that model was selected.
        axes: rotation axes of the arm's motions.
        residuals: (n, 6), measured minus predicted target pose: m in the camera frame, rad in the target frame.
    """

    pairs: PosePairs
    T_held: Array
    T_standing: Array
    covariance: Array
    used: Bools
    scatter: NoiseModel
    sizes: dict[str, float]
    reason: str
    axes: MotionAxes
    residuals: Array

    @property
    def inliers(self) -> Bools:
        """(n,) pairs whose translation and rotation were both used."""
        return np.asarray(self.used.all(axis=1))

    @property
    def flipped(self) -> Bools:
        """(n,) pairs with a correct translation and a wrong rotation, as from a flipped marker."""
        return np.asarray(self.used[:, 0] & ~self.used[:, 1])

    @property
    def weakest(self) -> str:
        """The least certain direction of translation, by name, with its standard deviation."""
        worst = []
        for k, name in enumerate(self.pairs.names):
            values, vectors = np.linalg.eigh(self.covariance[6 * k : 6 * k + 3, 6 * k : 6 * k + 3])
            own = name.split("_")[-1]
            axis = vectors[:, -1]
            main = int(np.argmax(np.abs(axis)))
            x, y, z = axis * np.sign(axis[main])
            along = "xyz"[main] if abs(axis[main]) > 0.9 else f"({x:.2f}, {y:.2f}, {z:.2f})"
            words = f"{name}: translation along {along} of the {own}, {1e3 * np.sqrt(values[-1]):.3g} mm"
            worst.append((float(values[-1]), words))
        return max(worst)[1]


def calibrate_pose_pairs(pairs: PosePairs, seed: int = 0) -> RobotWorld:
    """Estimate the poses of the held and of the fixed object with their covariance; outliers get no weight.

    Args:
        pairs: in the order in which they were taken.
        seed: of the consensus.

    Raises:
        CalibrationRefused: too few pairs, too few that agree, or rotations about one axis only; `data["reason"]` is
            "few_pairs", "no_consensus", "degenerate" or "parallel_axes".
    """
    both = np.concatenate([pairs.T_base_gripper, pairs.T_camera_target], axis=1)
    complete: Bools = np.asarray(np.isfinite(both).all(axis=(1, 2)))
    A, C = pairs.T_base_gripper[complete], pairs.T_camera_target[complete]
    if len(A) > FEWEST:
        refuse_parallel_axes(A[:, :3, :3])
    start = initial_guess(A, inverses(C) if pairs.camera_in_gripper else C, seed)
    agree = int(start.inliers.sum())
    if agree < max(FEWEST, CONSENSUS * len(A)):
        raise CalibrationRefused(
            f"{agree} of {len(A)} pairs of poses agree with each other, at least {FEWEST} and "
            f"{100 * CONSENSUS:.0f} % must: were arm and camera read at the same time, and is the target fixed?",
            reason="no_consensus",
            agree=agree,
            pairs=len(A),
        )
    axes = refuse_parallel_axes(A[start.inliers, :3, :3])
    held, standing = start.T_gripper_target, start.T_base_camera
    P, Q = (held, standing) if pairs.camera_in_gripper else (standing, held)
    closed = Closed(A, C, pairs.camera_in_gripper)
    fit, reason, used = _fitted(closed, P, Q, start.inliers)
    everything: Bools = np.zeros((len(complete), 2), dtype=bool)
    everything[complete] = used
    residuals = np.full((len(complete), 6), np.nan)
    residuals[complete] = fit.at.residuals
    P, Q, covariance = fit.P, fit.Q, fit.covariance
    if not pairs.camera_in_gripper:
        swap = np.r_[6:UNKNOWNS, 0:6]
        P, Q, covariance = Q, P, covariance[np.ix_(swap, swap)]
    return RobotWorld(
        pairs, P, Q, frozen(covariance), everything, fit.scatter, fit.size, reason, axes, frozen(residuals)
    )


def _fitted(closed: Closed, P: Array, Q: Array, inliers: Bools) -> tuple[PairFit, str, Bools]:
    """Return the fit with the best noise model, why it was selected, and what was used."""
    used = np.stack([inliers, inliers], axis=1)
    fit, reason = _best_camera(closed, P, Q, used)
    for _ in range(_ROUNDS):
        now = _right(fit)
        if (now == used).all():
            break
        used = now
        fit, reason = _best_camera(closed, fit.P, fit.Q, used)
    for richer, words in (
        ({"geometry": True}, "the arm's errors vary smoothly with its pose"),
        ({"freedom": _STRAYS}, "the errors have heavier tails than a normal distribution"),
    ):
        trial = fit_pairs(closed, fit.P, fit.Q, replace(fit.scatter, **richer), used, fit)
        gain = trial.log_likelihood - fit.log_likelihood
        if gain > _GAIN:
            fit, reason = trial, f"{reason}; {words} (+{gain:.1f})"
    return fit, reason, used


def _best_camera(closed: Closed, P: Array, Q: Array, used: Bools) -> tuple[PairFit, str]:
    axes = fit_pairs(closed, P, Q, NoiseModel("axes"), used)
    if axes.at.nearest <= 0.0:
        return axes, "camera errors are modelled along its axes: a target behind the camera is in no image"
    image = fit_pairs(closed, P, Q, NoiseModel("image"), used, axes)
    gain = image.log_likelihood - axes.log_likelihood
    if gain <= 0.0:
        return axes, f"camera errors fit its axes better than a target's image (log likelihood +{-gain:.1f})"
    reason = f"camera errors fit those of a target's image (log likelihood +{gain:.1f})"
    beside = fit_pairs(closed, image.P, image.Q, NoiseModel("image", off_centre=True), used, image)
    more = beside.log_likelihood - image.log_likelihood
    if more > _GAIN:
        return beside, f"{reason} whose centre is not its origin (+{more:.1f})"
    return image, reason


def _right(fit: PairFit) -> Bools:
    """Translations and rotations (n, 2) that fit the noise model; if one of the two does not, the other is kept."""
    r, S = fit.at.residuals, fit.covariances

    def within(rows: slice) -> Bools:
        e = r[:, rows]
        squares = np.einsum("ni,nij,nj->n", e, np.linalg.inv(S[:, rows, rows]), e)
        return np.asarray(squares < chi2_limit(_WRONG, e.shape[1]))

    whole, shift, turn = within(slice(0, 6)), within(slice(0, 3)), within(slice(3, 6))
    return np.stack([whole | (shift & ~turn), whole | (turn & ~shift)], axis=1)
