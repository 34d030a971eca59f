"""Doubts about a board's pose: each with its values, its limit and a remedy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.errors import ImpossibleError
from arm.numerics.products import mul
from arm.poses import BoardPose, adjoint
from arm.se3 import Array, inverse, transform
from vision.boards.arrangement import arrangement, other_focal
from vision.boards.marker_size import fit_marker_size
from vision.boards.pose_fit import Corners, Fit
from vision.boards.shared_errors import SAME_PRINT
from vision.camera.model import Camera
from vision.markers.detect import Marker

RESIDUAL_PX = 1.0  # largest rms residual of the mean corners, per coordinate
LENS_PX = 0.3  # residual from which the lens or the board is rather wrong than the images noisy
_LEAST_DEG, _IN_RAD = 0.05, ": is that limit in rad? The unit is deg"  # no look is as certain as this
MOVED_PX = 2.0  # largest deviation of a frame's markers from the median of all frames, and
SHAKEN_PX = 4.0  # at most, if the camera shakes
# Standard deviations of that deviation in images of a camera that shakes, and how many images tell that it does: a
# board that moves once, or evenly, leaves most second differences of its places small, a camera that shakes few.
_SHAKEN_SIGMAS, _LEAST_SHAKEN = 5.0, 10
# Median length of a second difference of points in a plane, in standard deviations of one coordinate.
_MEDIAN_SIGMAS = np.sqrt(2.0 * np.log(2.0) * 6.0)
# largest deviation of the best-fitting marker size from the stated one, in m (more if the board's tolerance allows it)
# and in its standard deviations
SIZE_M, SIZE_SIGMAS = 0.3e-3, 4.0
LOG_ODDS = 4.6  # natural logarithm of the odds at which the second solution is excluded: 100 to 1
FLIP = np.radians(1.0)  # rotation between the two solutions below which the second does not matter


@dataclass(frozen=True)
class BoardLimits:
    """Largest standard deviations of a board's pose.

    Each is a third of what a task tolerates: a cube that is 2 mm off still slides into its pocket, the palm hits a cube
    that is 8 mm higher than expected (docs/sources.md, "Boards and cubes"), and jaws that are rotated by 3 deg push a
    cube.

    Attributes:
        sideways_m: of the least certain hole, in the plate's plane, m.
        height_m: of the least certain hole, along the plate's normal, m.
        turn_rad: of the board's rotation about its least certain axis, rad.
    """

    sideways_m: float = 0.6e-3
    height_m: float = 2.0e-3
    turn_rad: float = np.radians(1.0)


@dataclass(frozen=True)
class Spread:
    """Standard deviations of a board's pose.

    Attributes:
        sideways, height: of the least certain hole, or of the centre of a plate without holes, in the plate's plane
            and along its normal, m.
        turn: of the rotation about the least certain axis, rad.
    """

    sideways: float
    height: float
    turn: float

    @classmethod
    def of(cls, pose: BoardPose) -> Spread:
        """Compute from the pose's covariance."""
        holes = [hole.covariance for hole in pose.holes] or [_at_centre(pose)]
        return cls(
            float(np.sqrt(max(np.linalg.eigvalsh(C[:2, :2])[-1] for C in holes))),
            float(np.sqrt(max(C[2, 2] for C in holes))),
            float(np.sqrt(np.linalg.eigvalsh(pose.covariance[3:, 3:])[-1])),
        )


def _at_centre(pose: BoardPose) -> Array:
    """Covariance of the pose of the centre of the plate's top, (6, 6)."""
    Ad = adjoint(inverse(transform(t=(*pose.board.plate.centre, 0.0))))
    return mul(mul(Ad, pose.covariance), Ad.T)


def seen_twice(board: Board, frames: Sequence[Sequence[Marker]]) -> ImpossibleError | None:
    """Return the doubt that two boards with equal ids are in view, if a marker is in one frame twice."""
    for frame in frames:
        for marker_id in board.marker_ids:
            at = [m.corners_px.mean(axis=0).tolist() for m in frame if m.id == marker_id]
            if len(at) > 1:
                (x0, y0), (x1, y1) = at[:2]
                return ImpossibleError(
                    f"board {board.name}: marker {marker_id} is in view twice, at {x0:.0f}, {y0:.0f} px and at "
                    f"{x1:.0f}, {y1:.0f} px; no pose is made of markers of two boards: each needs ids of its own",
                    board=board.name,
                    marker=marker_id,
                    markers_px=at,
                )
    return None


def moved(board: Board, corners: Corners) -> Iterator[ImpossibleError]:
    """Doubt that the board stood still: in some frame all corners of a marker are off in the same direction.

    With 10 frames or more, as much is allowed as shaking explains that the other frames show too, up to `SHAKEN_PX`.
    """
    off = (corners.pixels - corners.median()).reshape(len(corners.pixels), 2, 4, 2)
    detected = np.asarray(np.isfinite(off).all(axis=(2, 3)))
    shift = np.where(detected[..., None], np.median(off, axis=2), 0.0)  # (frames, markers, 2)
    noise = np.linalg.norm(off - shift[:, :, None], axis=-1)[detected]
    distance = np.linalg.norm(shift, axis=-1).max(axis=1)
    worst = int(np.argmax(distance))
    shaken = min(SHAKEN_PX, _SHAKEN_SIGMAS * _shaking(shift))
    if distance[worst] > max(MOVED_PX, 3.0 * float(np.median(noise)), shaken):
        yield ImpossibleError(
            f"board {board.name}: image {worst + 1} of {len(off)} shows it {distance[worst]:.1f} px off the "
            f"others, more than {MOVED_PX:g} px; it moved between images: look again once it is at rest",
            board=board.name,
            photograph=worst + 1,
            off_px=float(distance[worst]),
            limit_px=MOVED_PX,
        )


def _shaking(shift: Array) -> float:
    """Standard deviation, px, of shifts (frames, markers, 2) by a camera that shakes; 0 with too few frames."""
    if len(shift) < _LEAST_SHAKEN:
        return 0.0
    bends = np.linalg.norm(np.diff(shift, n=2, axis=0), axis=-1).max(axis=1)
    return float(np.median(bends) / _MEDIAN_SIGMAS)


def misfit(
    board: Board, corners: Corners, fit: Fit, camera: Camera, residual_px: float, floor_px: float
) -> Iterator[ImpossibleError]:
    """Doubt the marker size, or else the arrangement of the markers."""
    other = fit_marker_size(board, fit, camera, floor_px)
    allowed = max(SIZE_M, 1.5 * SAME_PRINT * board.tolerance)  # three standard deviations of prints
    if (
        other is not None
        and other.rms_px < RESIDUAL_PX
        and abs(other.size - board.marker_size) > max(SIZE_SIGMAS * other.sigma, allowed)
    ):
        yield ImpossibleError(
            f"board {board.name}: marker size = {1e3 * board.marker_size:g} mm does not fit its images "
            f"(residual {residual_px:.2f} px); {1e3 * other.size:.2f} mm does (+-{1e3 * other.sigma:.2f} mm, "
            f"residual {other.rms_px:.2f} px): measure the black square's edge; 1 mm puts the board's height 24 mm off",
            board=board.name,
            marker_size=board.marker_size,
            fitting_size=other.size,
            residual_px=residual_px,
        )
    elif not residual_px <= RESIDUAL_PX:
        found, why = _why_misfit(board, corners, camera, residual_px)
        yield ImpossibleError(
            f"board {board.name}: its markers' corners do not fit (residual {residual_px:.2f} px, allowed "
            f"{RESIDUAL_PX:g}); {why}",
            board=board.name,
            residual_px=residual_px,
            limit_px=RESIDUAL_PX,
            arrangement=found,
        )


def no_pose(board: Board, corners: Corners, camera: Camera) -> ImpossibleError:
    """Return the doubt about a board without a pose in front of the camera that its corners fit."""
    found, why = _why_misfit(board, corners, camera)
    outlines = corners.median().reshape(2, 4, 2)
    seen = " and ".join(
        f"marker {name} at {x:.0f}, {y:.0f} px"
        for name, (x, y) in zip(board.marker_ids, outlines.mean(axis=1), strict=True)
    )
    return ImpossibleError(
        f"board {board.name}: {seen} fit it in no pose in front of the camera; {why}; also check K_px and distortion "
        "of the camera file",
        board=board.name,
        markers_px=outlines.mean(axis=1).tolist(),
        arrangement=found,
    )


def _why_misfit(
    board: Board, corners: Corners, camera: Camera, residual_px: float = np.inf
) -> tuple[str | None, str]:
    """Return the arrangement of the markers that explains the corners, if there is one, and what to tell."""
    low, high = board.marker_ids
    if focal := other_focal(corners, camera, residual_px, RESIDUAL_PX):
        return None, focal
    found = arrangement(board, corners, camera, RESIDUAL_PX)
    asked = (
        f"are markers {low} and {high} both on this board, {low} at its origin, and in the same orientation?"
    )
    return found, found or asked


def ambiguous(board: Board, angle: float, log_odds: float, ratio: float) -> Iterator[ImpossibleError]:
    """Doubt that the second solution, rotated by `angle` (rad), is excluded."""
    if angle > FLIP and log_odds < LOG_ODDS:
        yield ImpossibleError(
            f"board {board.name}: its tilt cannot be distinguished from one rotated by {np.degrees(angle):.1f} deg "
            f"(odds {np.exp(log_odds):.0f} to 1, errors differ only by a factor of {ratio:.2f}); take more "
            "images, or use larger markers or more tilt",
            board=board.name,
            hypothesis_ratio=ratio,
            odds=float(np.exp(log_odds)),
            angle=angle,
        )


def _remedy(residual_px: float) -> str:
    """What makes a pose more certain. Noise leaves little in the mean of all images; what is left is of all alike."""
    usual = "use more images, even light, larger markers or a nearer camera"
    if residual_px < LENS_PX:
        return usual
    return (
        "are K_px and distortion of the camera file those of these images, and the markers where the board file has "
        f"them? Otherwise {usual}"
    )


def uncertain(pose: BoardPose, limits: BoardLimits) -> Iterator[ImpossibleError]:
    """Doubt that the pose is certain enough to grasp, by its covariance."""
    spread, where = Spread.of(pose), "a hole" if len(pose.board.holes) else "its middle"
    values = (
        (f"{where} sideways", 1e3 * spread.sideways, 1e3 * limits.sideways_m, "mm"),
        (f"{where}'s height", 1e3 * spread.height, 1e3 * limits.height_m, "mm"),
        ("its rotation", np.degrees(spread.turn), np.degrees(limits.turn_rad), "deg"),
    )
    over = [
        f"{what} to {value:.3g} {unit} (allowed {limit:g}{_IN_RAD if unit == 'deg' and limit < _LEAST_DEG else ''})"
        for what, value, limit, unit in values
        if value > limit
    ]
    if over:
        yield ImpossibleError(
            f"board {pose.board.name}: its pose is too uncertain to grasp: {', '.join(over)}, standard deviations, "
            f"with a residual of {pose.residual_px:.2f} px between corners and board; {_remedy(pose.residual_px)}",
            board=pose.board.name,
            sideways=spread.sideways,
            height=spread.height,
            turn=spread.turn,
        )
