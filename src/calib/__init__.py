"""Observations in, calibrations out: intrinsics, eye-to-hand, kinematics of any URDF robot."""

import arm.former  # noqa: F401  (former names are found)
