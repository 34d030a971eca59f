"""OpenCV's methods on A X = Y B."""

from __future__ import annotations

import cv2
import numpy as np

from arm.se3 import Array, transform
from calib.robot_world.reml import inverses

HAND_EYE = {
    "cv TSAI": cv2.CALIB_HAND_EYE_TSAI,
    "cv PARK": cv2.CALIB_HAND_EYE_PARK,
    "cv HORAUD": cv2.CALIB_HAND_EYE_HORAUD,
    "cv ANDREFF": cv2.CALIB_HAND_EYE_ANDREFF,
    "cv DANIILIDIS": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
ROBOT_WORLD = {
    "cv SHAH": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    "cv LI": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI,
}


def opencv(name: str, A: Array, B: Array) -> tuple[Array, Array | None] | None:
    """X and, if the method gives it, Y; None if it fails."""
    try:
        if name in HAND_EYE:
            target = inverses(B)
            R, t = cv2.calibrateHandEye(
                R_gripper2base=list(A[:, :3, :3]),
                t_gripper2base=list(A[:, :3, 3]),
                R_target2cam=list(target[:, :3, :3]),
                t_target2cam=list(target[:, :3, 3]),
                method=HAND_EYE[name],
            )
            found = [(R, t)]
        else:
            # B inverse(X) = inverse(Y) A: "base2world" is inverse(X), "gripper2cam" inverse(Y); of the ways to name
            # the four frames this one has the smallest errors here
            R_x, t_x, R_y, t_y = cv2.calibrateRobotWorldHandEye(
                R_world2cam=list(B[:, :3, :3]),
                t_world2cam=list(B[:, :3, 3]),
                R_base2gripper=list(A[:, :3, :3]),
                t_base2gripper=list(A[:, :3, 3]),
                method=ROBOT_WORLD[name],
            )
            found = [(R_x.T, -R_x.T @ t_x), (R_y.T, -R_y.T @ t_y)]
    except cv2.error:
        return None
    poses = [transform(R, np.reshape(t, 3)) for R, t in found]
    if not all(np.isfinite(T).all() for T in poses):
        return None
    return poses[0], poses[1] if len(poses) > 1 else None
