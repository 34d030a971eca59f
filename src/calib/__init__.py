"""Calibration from observations: camera intrinsics, hand-eye and robot-world, kinematics of any URDF robot."""

import arm.former  # noqa: F401  (former names are found)
