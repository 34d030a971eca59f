"""How far a calibration is from the truth, and how near it could have come."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from arm.robot.dh import DhTable
from arm.se3 import Array, Indices, angle_between, inverse, rotation, transform
from calib.chain.per_image_poses import fit_per_image_poses
from calib.hand_eye.calibrate import HandEye
from calib.hand_eye.chain import OFFSETS, arm_chain
from calib.recordings.arm import ArmRecording
from recorded.arm_sets import LENS, NOISE_PX, TARGETS, Truth

FIRST, LAST = 0, 5  # joints whose zeros are held: the gauges


@dataclass(frozen=True)
class Off:
    """A pose's error: mm and deg."""

    mm: float
    deg: float


def pose_off(T: Array, true: Array) -> Off:
    """Distance of two poses."""
    return Off(
        1e3 * float(np.linalg.norm(T[:3, 3] - true[:3, 3])),
        float(np.degrees(angle_between(T[:3, :3], true[:3, :3]))),
    )


def prediction_off(found: HandEye, truth: Truth, joints: Array) -> Off:
    """Rms error of the target's pose before the camera, predicted from readings that were not in the recording."""
    names = len(found.chain.names)
    chain = arm_chain(found.recording.dh, *found.start)
    predicted = chain.evaluate(joints, found.chain.fit.unknowns[:names]).T
    return _rms(predicted, truth.T_camera_target(joints))


def rigid_prediction_off(dh: DhTable, X: Array, Y: Array, truth: Truth, joints: Array) -> Off:
    """The same for T_gripper_target X and T_base_camera Y on the arm as its maker says."""
    none = np.zeros(12 + 4 * dh.joints)
    return _rms(arm_chain(dh, Y, X).evaluate(joints, none).T, truth.T_camera_target(joints))


def _rms(T: Array, true: Array) -> Off:
    off = [pose_off(a, b) for a, b in zip(T, true, strict=True)]
    return Off(*(float(np.sqrt(np.mean(np.square(v)))) for v in ([o.mm for o in off], [o.deg for o in off])))


def closed_forms(recording: ArmRecording) -> dict[str, tuple[Array, Array]]:
    """T_gripper_target and T_base_camera of SHAH and LI, all images believed."""
    none = np.zeros(12 + 4 * recording.dh.joints)
    A = arm_chain(recording.dh, np.eye(4), np.eye(4)).evaluate(recording.joints, none).T
    B = fit_per_image_poses(recording.camera, recording.points, recording.pixels).T_camera_target
    found = {}
    for name, method in (
        ("SHAH", cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH),
        ("LI", cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI),
    ):
        R_x, t_x, R_y, t_y = cv2.calibrateRobotWorldHandEye(
            R_world2cam=list(A[:, :3, :3]),
            t_world2cam=list(A[:, :3, 3]),
            R_base2gripper=list(B[:, :3, :3]),
            t_base2gripper=list(B[:, :3, 3]),
            method=method,
        )
        found[name] = transform(R_x, t_x.ravel()), transform(R_y, t_y.ravel())
    return found


def bound(truth: Truth, joints: Array, kind: str, noise_px: float = NOISE_PX) -> Array:
    """Covariance (6, 6) of T_base_camera's error, m along the base's axes and rad about them, that no unbiased
    estimator with place, mount and zeros of J2 to J5 unknown can undercut; derivatives by differences."""
    points, h = TARGETS[kind], 1e-6

    def at(x: Array) -> Array:
        place = transform(rotation(x[3:6]) @ truth.T_base_camera[:3, :3], truth.T_base_camera[:3, 3] + x[:3])
        mount = truth.T_gripper_target @ transform(rotation(x[9:12]), x[6:9])
        offsets = truth.offsets.copy()
        offsets[1:5] += x[12:]
        moved = replace(truth, T_base_camera=place, T_gripper_target=mount, offsets=offsets)
        return moved.pixels(joints, points).ravel()

    columns = [(at(e) - at(-e)) / (2.0 * h * noise_px) for e in h * np.eye(16)]
    J = np.stack(columns, axis=1)
    return np.asarray(np.linalg.inv(J.T @ J)[:6, :6])


def true_unknowns(
    found: HandEye, truth: Truth, image: Array | None = None, waves: Array | None = None
) -> Array:
    """All unknowns of a calibration, as they really are.

    Args:
        found: the calibration.
        truth: of arm and camera.
        image: unknowns of the image, see `calib.hand_eye.image_effects`; default: 0.
        waves: smooth errors of the joints, see `calib.hand_eye.chain.smooth_errors`; default: 0.
    """
    names = found.chain.names
    true = np.zeros(len(names))
    for first, T, T_true in zip(
        (0, 6), found.start, (truth.T_base_camera, truth.T_gripper_target), strict=True
    ):
        D = inverse(T) @ T_true
        true[first : first + 3] = D[:3, 3]
        true[first + 3 : first + 6] = Rotation.from_matrix(D[:3, :3]).as_euler("XYZ")
    of_arm = np.concatenate([truth.offsets, truth.d, truth.a, truth.alpha])
    end = OFFSETS + len(of_arm)
    true[OFFSETS:end] = of_arm
    if waves is not None:
        true[end : end + len(waves)] = waves
    if image is not None:
        true[len(true) - len(image) :] = image
    return true


def nees(found: HandEye, true: Array) -> tuple[float, int]:
    """Squared error of all unknowns that were fitted over their covariance, and how many they are."""
    return nees_of(found, true, np.flatnonzero(found.chain.problem.free))


def nees_of(found: HandEye, true: Array, which: Indices) -> tuple[float, int]:
    """The same for some unknowns."""
    off = (found.chain.fit.unknowns - true)[which]
    covariance = found.chain.covariance[np.ix_(which, which)]
    scale = np.sqrt(np.diag(covariance))
    return float(off / scale @ np.linalg.solve(covariance / np.outer(scale, scale), off / scale)), len(which)


def inside(pixels: Array) -> bool:
    """Whether all corners are in the image."""
    return bool(((pixels > 0) & (pixels < np.array(LENS.size) - 1.0)).all())
