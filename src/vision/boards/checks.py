"""What speaks against a board's pose: each doubt with its figures, its limit and what would help."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.board import Board
from arm.errors import ImpossibleError
from arm.poses import BoardPose, hole_poses
from vision.boards.arrangement import arrangement
from vision.boards.marker_size import fit_marker_size
from vision.boards.pose_fit import Corners, Fit
from vision.boards.shared_errors import SAME_PRINT
from vision.camera.model import Camera


@dataclass(frozen=True)
class BoardLimits:
    """What a board's corners may do before they are refused.

    The last three are standard deviations; what a task can bear lies three of them away: a cube finds its pocket
    from 2 mm beside it, the palm meets a cube that stands 8 mm higher than thought (fact sheet of the cell), and jaws
    that are 3 deg askew push a cube.

    Attributes:
        residual_px: largest root mean square residual of the mean corners, px per coordinate.
        moved_px: most that a frame's markers may be off the median of all frames, px.
        size_m: largest deviation of the marker size that fits best from the stated one, m; more if the board's
            tolerance allows it.
        size_sigmas: and this many of its standard deviations.
        log_odds: a second solution counts as excluded from these odds on (4.6: 100 to 1).
        flip_rad: second solutions turned by less than this do not matter.
        sideways_m: of the least certain hole, in the plate's plane, m.
        height_m: of the least certain hole, along the plate's normal, m.
        turn_rad: of the board's turn about its least certain axis, rad.
    """

    residual_px: float = 1.0
    moved_px: float = 2.0
    size_m: float = 0.3e-3
    size_sigmas: float = 4.0
    log_odds: float = 4.6
    flip_rad: float = np.radians(1.0)
    sideways_m: float = 0.6e-3
    height_m: float = 2.0e-3
    turn_rad: float = np.radians(1.0)


@dataclass(frozen=True)
class Spread:
    """Standard deviations of a board's pose: of its least certain hole in and across the plate, m, and turn, rad."""

    sideways: float
    height: float
    turn: float

    @classmethod
    def of(cls, pose: BoardPose) -> Spread:
        """From the pose's covariance."""
        holes = [hole.covariance for hole in hole_poses(pose)]
        return cls(
            float(np.sqrt(max(np.linalg.eigvalsh(C[:2, :2])[-1] for C in holes))),
            float(np.sqrt(max(C[2, 2] for C in holes))),
            float(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])),
        )


def moved(board: Board, corners: Corners, limits: BoardLimits) -> ImpossibleError | None:
    """The board stands elsewhere in one of the frames: all corners of a marker are off to the same side."""
    off = (corners.pixels - corners.median()).reshape(len(corners.pixels), 2, 4, 2)
    seen: npt.NDArray[np.bool_] = np.asarray(np.isfinite(off).all(axis=(2, 3)))
    shift = np.where(seen[..., None], np.median(off, axis=2), 0.0)  # (frames, markers, 2)
    noise = np.linalg.norm(off - shift[:, :, None], axis=-1)[seen]
    distance = np.linalg.norm(shift, axis=-1).max(axis=1)
    worst = int(np.argmax(distance))
    if distance[worst] > max(limits.moved_px, 3.0 * float(np.median(noise))):
        return ImpossibleError(
            f"board {board.name}: photograph {worst + 1} of {len(off)} shows it {distance[worst]:.1f} px off the "
            f"others, more than {limits.moved_px:g} px; it moved while it was photographed: look again once it "
            "stands still",
            board=board.name,
            photograph=worst + 1,
            off_px=float(distance[worst]),
            limit_px=limits.moved_px,
        )
    return None


def misfit(
    board: Board,
    corners: Corners,
    fit: Fit,
    camera: Camera,
    residual_px: float,
    floor_px: float,
    limits: BoardLimits,
) -> ImpossibleError | None:
    """Another marker size fits, the markers are arranged otherwise, or they fit no pose at all."""
    other = fit_marker_size(board, fit, camera, floor_px) if np.isfinite(residual_px) else None
    allowed = max(limits.size_m, 1.5 * SAME_PRINT * board.tolerance)  # three deviations of what prints do
    if (
        other is not None
        and other.rms_px < limits.residual_px
        and abs(other.size - board.marker_size) > max(limits.size_sigmas * other.sigma, allowed)
    ):
        return ImpossibleError(
            f"board {board.name}: marker size = {1e3 * board.marker_size:g} mm does not fit its photographs "
            f"(residual {residual_px:.2f} px); {1e3 * other.size:.2f} mm does (+-{1e3 * other.sigma:.2f} mm, "
            f"residual {other.rms_px:.2f} px): "
            "measure the black square's edge; 1 mm puts the board's height 24 mm off",
            board=board.name,
            marker_size=board.marker_size,
            fitting_size=other.size,
            residual_px=residual_px,
        )
    if not residual_px <= limits.residual_px:  # NaN where no pose in front of the camera fits
        low, high = board.marker_ids
        found = arrangement(board, corners, camera, limits.residual_px)
        why = found or (
            f"are markers {low} and {high} both on this board, {low} at its origin, and turned alike?"
        )
        return ImpossibleError(
            f"board {board.name}: its markers' corners do not fit (residual {residual_px:.2f} px, allowed "
            f"{limits.residual_px:g}); {why}",
            board=board.name,
            residual_px=residual_px,
            limit_px=limits.residual_px,
            arrangement=found,
        )
    return None


def ambiguous(
    board: Board, angle: float, log_odds: float, ratio: float, limits: BoardLimits
) -> ImpossibleError | None:
    """The mirrored solution, turned by `angle`, is too likely."""
    if angle > limits.flip_rad and log_odds < limits.log_odds:
        return ImpossibleError(
            f"board {board.name}: its tilt cannot be told from one turned by {np.degrees(angle):.1f} "
            f"deg (odds {np.exp(log_odds):.0f} to 1, errors differ by a factor of {ratio:.2f} only); more "
            "photographs, larger markers or more tilt would help",
            board=board.name,
            hypothesis_ratio=ratio,
            odds=float(np.exp(log_odds)),
            angle=angle,
        )
    return None


def uncertain(pose: BoardPose | None, limits: BoardLimits) -> ImpossibleError | None:
    """The pose's own covariance says that it may be off by more than a grasp can bear."""
    if pose is None:
        return None
    spread = Spread.of(pose)
    values = (
        ("a hole sideways", 1e3 * spread.sideways, 1e3 * limits.sideways_m, "mm"),
        ("a hole's height", 1e3 * spread.height, 1e3 * limits.height_m, "mm"),
        ("its turn", np.degrees(spread.turn), np.degrees(limits.turn_rad), "deg"),
    )
    over = [
        f"{what} to {value:.2g} {unit} (allowed {limit:g})"
        for what, value, limit, unit in values
        if value > limit
    ]
    if not over:
        return None
    return ImpossibleError(
        f"board {pose.board.name}: its pose is too uncertain to grasp: {', '.join(over)}, standard deviations, with "
        f"{pose.residual_px:.2f} px between corners and board; more photographs, even light, larger markers or a "
        "camera nearer to the board would help",
        board=pose.board.name,
        sideways=spread.sideways,
        height=spread.height,
        turn=spread.turn,
    )
