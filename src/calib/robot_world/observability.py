"""Observability of robot-world/hand-eye calibration: rotations about one axis, or nearly one, are degenerate.

If all rotation axes are parallel, the translation along them and the rotation about them are not determined. Closed
forms do not detect this: they return poses that are metres off.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from arm.errors import CalibrationRefused
from arm.se3 import Array, frozen

MOTION = np.radians(3.0)  # smallest rotation that counts as a motion; the axis of a smaller one is noise
SPREAD = np.radians(9.0)  # of the motions' axes: a cone of 10 deg has 4 to 7, one of 45 deg 15 and more
SECOND = 0.22  # rad of rotation about a second axis among all poses; more suffices whatever the spread
_POSES = 100  # compared with each other


@dataclass(frozen=True, eq=False)
class MotionAxes:
    """Rotation axes of an arm's motions.

    Attributes:
        main: unit vector (3,) in the gripper, the axis of most rotation.
        spread: rms angle between the motions' axes and `main`, rad: 0 if all are parallel, pi / 4 if all directions of
            a plane are equally frequent.
        second: rotations about a second axis among all poses, rms in rad.
        motions: number of motions.
    """

    main: Array
    spread: float
    second: float
    motions: int

    @property
    def degenerate(self) -> bool:
        """Whether part of the poses is not determined."""
        return self.motions < 2 or (self.spread < SPREAD and self.second < SECOND)


def motion_axes(rotations: Array) -> MotionAxes:
    """Return the rotation axes of the motions between consecutive gripper poses.

    Args:
        rotations: R_base_gripper (n, 3, 3), in the order in which they were taken.
    """
    kept = [0]
    for i in range(1, len(rotations)):
        if Rotation.from_matrix(rotations[kept[-1]].T @ rotations[i]).magnitude() >= MOTION:
            kept.append(i)
    few = np.unique(np.linspace(0, len(rotations) - 1, min(len(rotations), _POSES)).round().astype(int))
    if len(kept) < 3:
        return MotionAxes(frozen((0.0, 0.0, 1.0)), 0.0, 0.0, len(kept) - 1)
    motions, axes = _moments(rotations[kept[:-1]], rotations[kept[1:]])
    one, other = np.triu_indices(len(few), 1)
    everything, _ = _moments(rotations[few[one]], rotations[few[other]])
    return MotionAxes(
        frozen(axes[:, 2]),
        float(np.arctan2(np.sqrt(motions[1]), np.sqrt(motions[2]))),
        float(np.sqrt(everything[1])),
        len(kept) - 1,
    )


def _moments(first: Array, then: Array) -> tuple[Array, Array]:
    """Second moments of rotations along their principal axes, ascending, and these axes as columns."""
    turns = Rotation.from_matrix(first.transpose(0, 2, 1) @ then).as_rotvec()
    angle = np.linalg.norm(turns, axis=1)
    chords = turns * np.sinc(angle / (2.0 * np.pi))[:, None]  # a full revolution counts as none
    values, vectors = np.linalg.eigh(chords.T @ chords / len(chords))
    return np.maximum(values, 0.0), vectors


def refuse_parallel_axes(rotations: Array) -> MotionAxes:
    """Return the rotation axes of the motions between R_base_gripper (n, 3, 3).

    Raises:
        CalibrationRefused: they are parallel or nearly so.
    """
    axes = motion_axes(rotations)
    if axes.degenerate:
        x, y, z = axes.main
        raise CalibrationRefused(
            f"the arm rotated about one axis only: its {axes.motions} motions have axes within "
            f"{np.degrees(axes.spread):.1f} deg (rms) of ({x:.2f}, {y:.2f}, {z:.2f}) in the gripper, so the "
            "translation along it and the rotation about it stay unknown; rotate the gripper about a second axis by 15 "
            "deg or more",
            reason="parallel_axes",
            spread_rad=axes.spread,
            second_rad=axes.second,
            axis=axes.main.tolist(),
            motions=axes.motions,
        )
    return axes
