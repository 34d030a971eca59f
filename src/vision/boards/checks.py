"""Doubts about a board's pose: each with its values, its limit and a remedy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.errors import ImpossibleError
from arm.poses import BoardPose
from arm.se3 import Bools
from vision.boards.arrangement import arrangement
from vision.boards.marker_size import fit_marker_size
from vision.boards.pose_fit import Corners, Fit
from vision.boards.shared_errors import SAME_PRINT
from vision.camera.model import Camera


@dataclass(frozen=True)
class BoardLimits:
    """Limits for accepting a board's pose.

    The last three are standard deviations, a third of what a task tolerates: a cube slides into its pocket from 2 mm
    aside, the palm hits a cube that is 8 mm higher than expected (fact sheet of the cell), and jaws that are 3 deg off
    push a cube.

    Attributes:
        residual_px: largest rms residual of the mean corners, px per coordinate.
        moved_px: largest deviation of a frame's markers from the median of all frames, px.
        size_m: largest deviation of the best-fitting marker size from the stated one, m; more if the board's tolerance
            allows it.
        size_sigmas: the same in its standard deviations.
        log_odds: from which a second solution is excluded (4.6: 100 to 1).
        flip_rad: a second solution that is rotated by less does not matter.
        sideways_m: of the least certain hole, in the plate's plane, m.
        height_m: of the least certain hole, along the plate's normal, m.
        turn_rad: of the board's rotation about its least certain axis, rad.
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
    """Standard deviations of a board's pose: least certain hole in and across the plate, m; rotation, rad."""

    sideways: float
    height: float
    turn: float

    @classmethod
    def of(cls, pose: BoardPose) -> Spread:
        """Compute from the pose's covariance."""
        holes = [hole.covariance for hole in pose.holes]
        return cls(
            float(np.sqrt(max(np.linalg.eigvalsh(C[:2, :2])[-1] for C in holes))),
            float(np.sqrt(max(C[2, 2] for C in holes))),
            float(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])),
        )


def moved(board: Board, corners: Corners, limits: BoardLimits) -> ImpossibleError | None:
    """Doubt that the board moved between frames: all corners of a marker are off in the same direction."""
    off = (corners.pixels - corners.median()).reshape(len(corners.pixels), 2, 4, 2)
    seen: Bools = np.asarray(np.isfinite(off).all(axis=(2, 3)))
    shift = np.where(seen[..., None], np.median(off, axis=2), 0.0)  # (frames, markers, 2)
    noise = np.linalg.norm(off - shift[:, :, None], axis=-1)[seen]
    distance = np.linalg.norm(shift, axis=-1).max(axis=1)
    worst = int(np.argmax(distance))
    if distance[worst] > max(limits.moved_px, 3.0 * float(np.median(noise))):
        return ImpossibleError(
            f"board {board.name}: photograph {worst + 1} of {len(off)} shows it {distance[worst]:.1f} px off the "
            f"others, more than {limits.moved_px:g} px; it moved between photographs: look again once it is at rest",
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
    """Doubt that the marker size or the arrangement of the markers is right, or that any pose fits."""
    other = fit_marker_size(board, fit, camera, floor_px) if np.isfinite(residual_px) else None
    allowed = max(limits.size_m, 1.5 * SAME_PRINT * board.tolerance)  # three standard deviations of prints
    if (
        other is not None
        and other.rms_px < limits.residual_px
        and abs(other.size - board.marker_size) > max(limits.size_sigmas * other.sigma, allowed)
    ):
        return ImpossibleError(
            f"board {board.name}: marker size = {1e3 * board.marker_size:g} mm does not fit its photographs "
            f"(residual {residual_px:.2f} px); {1e3 * other.size:.2f} mm does (+-{1e3 * other.sigma:.2f} mm, "
            f"residual {other.rms_px:.2f} px): measure the black square's edge; 1 mm puts the board's height 24 mm off",
            board=board.name,
            marker_size=board.marker_size,
            fitting_size=other.size,
            residual_px=residual_px,
        )
    if not residual_px <= limits.residual_px:  # NaN if no pose in front of the camera fits
        low, high = board.marker_ids
        found = arrangement(board, corners, camera, limits.residual_px)
        why = found or (
            f"are markers {low} and {high} both on this board, {low} at its origin, and in the same orientation?"
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
    """Doubt that the mirrored solution, rotated by `angle`, is excluded."""
    if angle > limits.flip_rad and log_odds < limits.log_odds:
        return ImpossibleError(
            f"board {board.name}: its tilt cannot be distinguished from one rotated by {np.degrees(angle):.1f} deg "
            f"(odds {np.exp(log_odds):.0f} to 1, errors differ only by a factor of {ratio:.2f}); take more "
            "photographs, or use larger markers or more tilt",
            board=board.name,
            hypothesis_ratio=ratio,
            odds=float(np.exp(log_odds)),
            angle=angle,
        )
    return None


def uncertain(pose: BoardPose | None, limits: BoardLimits) -> ImpossibleError | None:
    """Doubt that the pose is certain enough to grasp, by its own covariance."""
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
        f"board {pose.board.name}: its pose is too uncertain to grasp: {', '.join(over)}, standard deviations, with a "
        f"residual of {pose.residual_px:.2f} px between corners and board; use more photographs, even light, larger "
        "markers or a nearer camera",
        board=pose.board.name,
        sideways=spread.sideways,
        height=spread.height,
        turn=spread.turn,
    )
