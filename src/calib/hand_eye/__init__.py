"""Hand-eye calibration: camera, joint offsets and link errors of an arm, and the poses to take for it."""

from typing import TYPE_CHECKING

from arm.former import FormerNames

if not TYPE_CHECKING:
    __getattr__ = FormerNames(
        __name__, "calib.hand_eye.calibrate", "HandEye", "hand_eye_problem", "calibrate_hand_eye"
    )
