"""What looking gives to planning: poses with their uncertainty.

A covariance is of the twist xi = (translation m, rotation rad) in the body's own frame, T_true = T_estimate exp(xi),
(6, 6), translation first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import TOLERANCE_SDS, Board
from arm.numerics.angles import arccos
from arm.numerics.products import mul
from arm.se3 import Array, frozen, inverse, skew


@dataclass(frozen=True)
class TiltHypothesis:
    """How a board's tilt agrees with a set of tilts at which boards are known to stand.

    Attributes:
        nearest: member of the set, rad.
        z: tilt minus that member, in standard deviations (of the pose and of stands).
        probability: of that member, against the others and against a board that leans anywhere.
        fits: whether it may be that member; if not, the board stands at none of the set.
    """

    nearest: float
    z: float
    probability: float
    fits: bool


@dataclass(frozen=True)
class BoardPose:
    """Where a board stands.

    Attributes:
        board: which.
        T_base_board: its frame in the base, 4x4.
        covariance: (6, 6), see the module.
        residual_px: root mean square of the corner residuals, px (per coordinate).
        hypothesis_ratio: error of the second planar solution over the first; near 1 means the tilt may be flipped.
        tilt_hypothesis: agreement with the tilts that stands have, if any were given; the pose does not depend on it.
    """

    board: Board
    T_base_board: Array
    covariance: Array
    residual_px: float
    hypothesis_ratio: float
    tilt_hypothesis: TiltHypothesis | None = None

    def tilt(self) -> float:
        """Angle of the board's normal from the vertical, rad."""
        return float(arccos(self.T_base_board[2, 2]))


@dataclass(frozen=True)
class HolePose:
    """Where one hole is: centre on the plate's top surface, z out of the plate.

    Attributes:
        board: name of its board.
        index: 0 to 3, in the order of the CSV.
        T_base_hole: 4x4.
        covariance: (6, 6), see the module.
    """

    board: str
    index: int
    T_base_hole: Array
    covariance: Array

    @property
    def name(self) -> str:
        """Such as ``01-02/3``: board and hole, counted from 1 as on paper."""
        return f"{self.board}/{self.index + 1}"


def adjoint(T_a_b: Array) -> Array:
    """The (6, 6) map of twists (translation first) from frame b to frame a."""
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    Ad = np.zeros((6, 6))
    Ad[:3, :3] = Ad[3:, 3:] = R
    Ad[:3, 3:] = mul(skew(t), R)
    return Ad


def hole_poses(pose: BoardPose) -> tuple[HolePose, ...]:
    """The four holes of a board, covariance carried along; that of the plate's making is added, in its plane."""
    holes = []
    made = np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]) * (pose.board.tolerance / TOLERANCE_SDS) ** 2
    for index in range(len(pose.board.holes)):
        T_board_hole = pose.board.T_board_hole(index)
        Ad = adjoint(inverse(T_board_hole))
        holes.append(
            HolePose(
                pose.board.name,
                index,
                frozen(mul(pose.T_base_board, T_board_hole)),
                frozen(mul(mul(Ad, pose.covariance), Ad.T) + made),
            )
        )
    return tuple(holes)
