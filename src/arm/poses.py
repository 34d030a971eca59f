"""Poses with uncertainty, from vision to planning.

A covariance (6, 6) is that of the twist xi = (translation m, rotation rad) in the body's own frame, with
T_true = T_estimate exp(xi).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from arm.board import TOLERANCE_SDS, Board
from arm.numerics.angles import arccos
from arm.numerics.products import mul
from arm.se3 import Array, frozen, inverse, skew


@dataclass(frozen=True)
class TiltHypothesis:
    """Agreement of a board's tilt with a set of known tilts of stands.

    Attributes:
        nearest: nearest tilt of the set, rad.
        z: difference from that tilt, in standard deviations (of the pose and of stands).
        probability: of that tilt, against the others and against an arbitrary tilt.
        fits: whether the board may have that tilt; if not, its tilt is not in the set.
    """

    nearest: float
    z: float
    probability: float
    fits: bool


@dataclass(frozen=True)
class HolePose:
    """Pose of a hole: origin at its centre on the plate's top surface, z out of the plate.

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
        """Board and hole, counted from 1, such as ``01-02/3``."""
        return f"{self.board}/{self.index + 1}"


@dataclass(frozen=True)
class BoardPose:
    """Pose of a board.

    Attributes:
        board: the board.
        T_base_board: its frame in the base, 4x4.
        covariance: (6, 6), see the module.
        residual_px: root mean square of the corners' reprojection errors, px per coordinate.
        hypothesis_ratio: error of the second planar solution over the first; near 1 the tilt may be flipped.
        tilt_hypothesis: agreement with known tilts of stands, or None; the pose does not depend on it.
        repeatability: the part of `covariance`, (6, 6), that other images of the board at rest would draw anew: noise
            of its corners and of the camera's measured shift. A mean of poses lowers only this part; they share the
            rest, such as errors of the print. None if unknown.
    """

    board: Board
    T_base_board: Array
    covariance: Array
    residual_px: float
    hypothesis_ratio: float
    tilt_hypothesis: TiltHypothesis | None = None
    repeatability: Array | None = None

    def tilt(self) -> float:
        """Return the angle of the board's normal to the vertical, rad."""
        return float(arccos(self.T_base_board[2, 2]))

    @cached_property
    def holes(self) -> tuple[HolePose, ...]:
        """The board's holes, with propagated covariances plus the plate's tolerance in its plane."""
        made = np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]) * (self.board.tolerance / TOLERANCE_SDS) ** 2
        return tuple(self._hole(index, made) for index in range(len(self.board.holes)))

    def _hole(self, index: int, made: Array) -> HolePose:
        T_board_hole = self.board.T_board_hole(index)
        Ad = adjoint(inverse(T_board_hole))
        T_base_hole = frozen(mul(self.T_base_board, T_board_hole))
        return HolePose(
            self.board.name, index, T_base_hole, frozen(mul(mul(Ad, self.covariance), Ad.T) + made)
        )


def adjoint(T_a_b: Array) -> Array:
    """Return the (6, 6) map of twists (translation first) from frame b to frame a."""
    R, t = T_a_b[:3, :3], T_a_b[:3, 3]
    Ad = np.zeros((6, 6))
    Ad[:3, :3] = Ad[3:, 3:] = R
    Ad[:3, 3:] = mul(skew(t), R)
    return Ad
