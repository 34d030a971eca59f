"""A chain, and what a camera sees along it."""

import numpy as np

from arm.se3 import Array, rot_x, rotation, transform
from calib.model.chain import Chain, Fixed, Motion, Unknown, joined, pose_unknowns

X, Y, Z = np.eye(3)

ARM = (
    Motion(Z, reading=0, unknowns=(Unknown(6),)),
    Fixed(transform(rot_x(-np.pi / 2), (0.0, 0.0, 0.3))),
    Motion(Z, reading=1, unknowns=(Unknown(7), Unknown(9, "torque"))),
    Fixed(transform(t=(0.3, 0.0, 0.0))),
    Motion(Y, reading=2, unknowns=(Unknown(8),)),
    Motion(X, turns=False, reading=3),
    Fixed(transform(rotation([0.1, -0.3, 0.2]), (0.02, 0.03, 0.1))),
)

COUNT, READINGS = 10, 4

PLACE = transform(rotation([0.0, np.pi * 0.9, 0.1]), (0.2, 0.05, 1.3))


def eye_to_hand() -> Chain:
    """Camera's place with six unknowns, then the arm."""
    return joined([Fixed(PLACE), *pose_unknowns(0), *ARM])


def gains(readings: Array, unknowns: Array) -> dict[str, Array]:
    """Torque of the second joint."""
    return {"torque": np.cos(readings[:, 1])}


def readings(seed: int, count: int = 30) -> Array:
    """Random readings of the four joints."""
    rng = np.random.default_rng(seed)
    return rng.uniform([-0.5, -0.6, -0.6, -0.05], [0.5, 0.6, 0.6, 0.05], (count, READINGS))
