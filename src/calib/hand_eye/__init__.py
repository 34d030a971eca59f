"""Hand-eye calibration: camera, joint offsets and link errors of an arm, and the poses to take for it."""

from arm.former import former_names

former_names(__name__, "calib.hand_eye.calibrate", "HandEye", "hand_eye_problem", "calibrate_hand_eye")
