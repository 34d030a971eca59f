"""First-order errors of holes and of the tool in a calibrated cell, source by source.

Camera and arm share the covariance of their calibration, so that what is common cancels: a base that is rotated with
its camera misses nothing. Boards add what their detection is worth, arrivals what the joints scatter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.board import TOLERANCE_SDS
from arm.calibration_file import COVARIANCE, ArmCalibration
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.poses import BoardPose, adjoint
from arm.robot.dh import A465
from arm.robot.error_screws import error_screws
from arm.robot.model import Robot
from arm.se3 import Array, frozen, inverse
from cell.accuracy.linear_error import ErrorGroup, LinearError
from cell.config.cell import Cell
from vision.camera.projection import Projection

DETECTION, BOARD, CAMERA, OFFSETS, LINKS, LENS = (
    "detection",
    "board and print",
    "camera pose",
    "joint offsets",
    "links",
    "lens",
)
SCATTER, FOLLOWING, TOOL = "repeatability", "following", "tool"
_CALIBRATION = {
    CAMERA: COVARIANCE[0],
    OFFSETS: COVARIANCE[1],
    LINKS: sum(COVARIANCE[2:5]),
    LENS: COVARIANCE[5],
}


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """The sources of error of a cell, for one observation of its boards.

    All twists are of a body in the base frame, translation first, with T_true = exp(twist) T_estimate.

    Attributes:
        cell: with a calibration that has a covariance.
        calibration: of the cell.
        shared: errors of camera and arm.
        tool: errors of the tool's frame on the flange.
        robot: the cell's arm, jaws anywhere.
    """

    cell: Cell
    calibration: ArmCalibration
    shared: ErrorGroup
    tool: ErrorGroup
    robot: Robot

    @staticmethod
    def available(cell: Cell) -> bool:
        """Whether the cell has a calibration with a covariance."""
        return cell.calibration is not None and cell.calibration.covariance is not None

    @classmethod
    def of(cls, cell: Cell, robot: Robot | None = None) -> ErrorModel:
        """Return the model of a cell, with its arm if that is at hand.

        Raises:
            ImpossibleError: the cell has no calibration, or one without a covariance.
        """
        made = cell.calibration
        if made is None or made.covariance is None:
            what = "no calibration" if made is None else f"calibration {made.id} without a covariance"
            raise ImpossibleError(
                f"{cell.file.name} has {what}, so the error of a placement is unknown; calibrate with a465 calibrate "
                "hand-eye --apply",
                file=str(cell.file),
            )
        tool = np.diag([cell.tool_tolerance / TOLERANCE_SDS] * 3) ** 2
        shared = ErrorGroup(made.covariance, _CALIBRATION)
        return cls(cell, made, shared, ErrorGroup.of(TOOL, tool), robot or cell.robot())

    def board(self, pose: BoardPose) -> BoardError:
        """Errors of a board, to be asked for once: all its holes share them."""
        repeated = np.zeros((6, 6)) if pose.repeatability is None else pose.repeatability
        rest = _positive_semidefinite(pose.covariance - repeated)
        by_camera, by_lens = _by_camera(self.cell, pose)
        others = np.zeros((6, sum(COVARIANCE[1:5])))
        to_base = adjoint(pose.T_base_board)
        return BoardError(
            pose,
            LinearError(
                {
                    self.shared: to_base @ np.hstack([by_camera, others, by_lens]),
                    ErrorGroup.of(DETECTION, repeated): to_base,
                    ErrorGroup.of(BOARD, rest): to_base,
                }
            ),
        )

    def tool_error(self, q: npt.ArrayLike) -> LinearError:
        """Error of the tool at one arrival at joint positions q (6,) rad: two arrivals share all but the scatter."""
        screws = error_screws(A465, self.calibration.links, q)
        arm = np.hstack([np.zeros((6, COVARIANCE[0])), screws, np.zeros((6, COVARIANCE[-1]))])
        by_joint = screws[:, : COVARIANCE[1]]
        scatter = np.zeros(6) if self.calibration.scatter is None else self.calibration.scatter
        return LinearError(
            {
                self.shared: arm,
                ErrorGroup.of(SCATTER, np.diag(scatter**2)): by_joint,
                ErrorGroup.of(FOLLOWING, self.cell.following_error**2 * np.eye(6)): by_joint,
                self.tool: adjoint(self.T_base_tool(q))[:, :3],
            }
        )

    def T_base_tool(self, q: npt.ArrayLike) -> Array:
        """Pose of the tool, 4x4."""
        return self.robot.T_base_tool(q)


@dataclass(frozen=True, eq=False)
class BoardError:
    """Errors of a board in the base frame.

    Attributes:
        pose: its estimate.
        shared: error that all its holes share.
    """

    pose: BoardPose
    shared: LinearError

    def hole(self, index: int) -> LinearError:
        """Error of a hole, 0 to 3, with the plate's tolerance in its plane."""
        made = np.diag([1.0, 1.0]) * (self.pose.board.tolerance / TOLERANCE_SDS) ** 2
        in_plane = adjoint(mul(self.pose.T_base_board, self.pose.board.T_board_hole(index)))[:, :2]
        return self.shared + LinearError({ErrorGroup.of(BOARD, made): in_plane})


def _by_camera(cell: Cell, pose: BoardPose) -> tuple[Array, Array]:
    """Change of a board's twist in its own frame by the camera's twist (6, 6) and by the intrinsics (6, 9).

    The images are as they are: a change of the intrinsics moves the board to where its corners project to them again.
    """
    T_camera_board = mul(inverse(cell.camera.T_base_camera), pose.T_base_board)
    seen = Projection(cell.camera.at(np.eye(4)), T_camera_board, pose.board.marker_corners().reshape(-1, 3))
    by_board, by_lens = seen.by_target.reshape(-1, 6), seen.by_intrinsics.reshape(-1, 9)
    back = np.asarray(np.linalg.pinv(by_board), dtype=float)
    return adjoint(inverse(T_camera_board)), -back @ by_lens


def _positive_semidefinite(covariance: Array) -> Array:
    """The covariance without directions of negative variance, which rounding leaves."""
    values, vectors = np.linalg.eigh(covariance)
    return frozen(vectors * np.clip(values, 0.0, None) @ vectors.T)
