"""Observations in, calibrations out: intrinsics, eye-to-hand, kinematics of any URDF robot."""
