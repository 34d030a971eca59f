"""Where a board stands: one joint estimate over both markers and all frames, with an honest covariance, or a refusal.

Fact sheet of calibration, section 4: fusing corners and fitting once reaches the Cramer-Rao bound; a median of poses or
of corners throws 20-40 % away; one marker alone flips its tilt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.errors import ImpossibleError
from arm.poses import BoardPose
from arm.se3 import angle_between, frozen
from vision.arrangement import arrangement
from vision.board_fit import Corners, Fit, fit_pose, fit_weighted, planar_poses, pose_jacobian
from vision.camera import Camera
from vision.marker_size import fit_marker_size
from vision.markers import Marker

COMMON_MODE_PX = {"lines": 0.02, "subpix": 0.15, "recorded": 0.02}
"""Error of a corner that all frames share, at least: light, blur, lens. More frames do not average it."""
MERGED_RAD = 1e-3  # second solutions this near are the first one
RATIO_CAP = 1e3  # of `BoardPose.hypothesis_ratio`; also where there is no second solution


@dataclass(frozen=True)
class BoardLimits:
    """What a board's corners may do before they are refused.

    Attributes:
        residual_px: largest root mean square residual of the median corners, px per coordinate.
        moved_px: most that a frame's corners may be off the median of all frames, px.
        size_m: largest deviation of the marker size that fits best from the stated one, m.
        size_sigmas: and this many of its standard deviations.
        odds_log: a second solution counts as excluded if its squared error is larger by this many variances
            (9.2: odds of 100 to 1).
        flip_rad: second solutions turned by less than this do not matter.
    """

    residual_px: float = 1.0
    moved_px: float = 2.0
    size_m: float = 0.3e-3
    size_sigmas: float = 4.0
    odds_log: float = 9.2
    flip_rad: float = np.radians(1.0)


@dataclass(frozen=True, eq=False)
class BoardSeen:
    """What a board's markers say of it.

    Attributes:
        pose: the best estimate, also where it is doubted; None where there is none.
        doubts: why it must not be used, each with its data; none where it may.
    """

    pose: BoardPose | None
    doubts: tuple[ImpossibleError, ...]

    @property
    def accepted(self) -> bool:
        """Whether the pose may be used."""
        return self.pose is not None and not self.doubts


def estimate_board_pose(
    board: Board, frames: Sequence[Sequence[Marker]], camera: Camera, limits: BoardLimits | None = None
) -> BoardPose:
    """`assess_board` for those who have no use for a pose that is doubted.

    Raises:
        ImpossibleError: a marker is in no frame, the board moved between frames, another marker size fits, the
            corners do not fit the board at all, or its tilt cannot be told from the mirrored one.
    """
    seen = assess_board(board, frames, camera, limits)
    for doubt in seen.doubts:
        raise doubt
    if seen.pose is None:
        raise ImpossibleError(f"board {board.name}: its markers' corners fit no pose", board=board.name)
    return seen.pose


def assess_board(
    board: Board, frames: Sequence[Sequence[Marker]], camera: Camera, limits: BoardLimits | None = None
) -> BoardSeen:
    """Pose of a board from the markers seen in each frame, and all that speaks against it.

    Args:
        board: whose markers are used; others are ignored.
        frames: the markers of each photograph of a cell that stands still.
        camera: lens and place.
        limits: what is doubted.
    """
    limits = limits or BoardLimits()
    corners = _gather(board, frames)
    if isinstance(corners, ImpossibleError):
        return BoardSeen(None, (corners,))
    hypotheses = _Hypotheses.of(corners, camera)
    best = hypotheses.best
    floor = max(COMMON_MODE_PX[m.method] for frame in frames for m in frame if m.id in board.marker_ids)
    variance = _mean_variance(corners, best, floor)
    residual_px = _residual(corners, best)
    doubts = (
        _moved(board, corners, limits),
        _misfit(board, corners, best, camera, residual_px, floor, limits),
        _ambiguous(board, hypotheses, variance, limits),
    )
    found = tuple(doubt for doubt in doubts if doubt is not None)
    totals = best.weights.sum(axis=0)
    share = np.sqrt(totals / totals.mean())[:, None, None]
    J = (share * pose_jacobian(best.T_camera_board, corners.points, camera)).reshape(-1, 6)
    if not np.isfinite(J).all() or not np.isfinite(variance):
        return BoardSeen(None, found)
    pose = BoardPose(
        board,
        frozen(camera.T_base_camera @ best.T_camera_board),
        frozen(variance * np.linalg.inv(J.T @ J)),
        residual_px,
        hypotheses.ratio,
    )
    return BoardSeen(pose, found)


@dataclass(frozen=True)
class _Hypotheses:
    """The two planar solutions, both fitted with the weights of the better one; angle between them in rad."""

    best: Fit
    second: Fit
    angle: float
    ratio: float

    @classmethod
    def of(cls, corners: Corners, camera: Camera) -> _Hypotheses:
        starts = planar_poses(corners.median(), corners.points, camera)
        best = fit_pose(corners, starts[0], camera)
        second = fit_weighted(corners, best.weights, starts[-1], camera)
        if second.cost < best.cost:
            best = fit_pose(corners, second.T_camera_board, camera)
            second = fit_weighted(corners, best.weights, starts[0], camera)
        angle = angle_between(best.T_camera_board[:3, :3], second.T_camera_board[:3, :3])
        merged = angle < MERGED_RAD
        ratio = RATIO_CAP if merged else float(np.sqrt(second.cost / max(best.cost, 1e-12)))
        return cls(best, second, angle, float(np.clip(ratio, 1.0, RATIO_CAP)))


def _gather(board: Board, frames: Sequence[Sequence[Marker]]) -> Corners | ImpossibleError:
    pixels = np.full((len(frames), 2, 4, 2), np.nan)
    for index, frame in enumerate(frames):
        for marker in frame:
            if marker.id in board.marker_ids:
                pixels[index, board.marker_ids.index(marker.id)] = marker.corners_px
    seen = np.isfinite(pixels).all(axis=(2, 3)).any(axis=0)
    if not seen.all():
        missing = [i for i, s in zip(board.marker_ids, seen, strict=True) if not s]
        names = " and ".join(map(str, missing))
        return ImpossibleError(
            f"board {board.name}: marker {names} is in none of {len(frames)} photographs; the pose needs both, because "
            "one marker alone flips its tilt; uncover it or move the board into view",
            board=board.name,
            missing=missing,
            photographs=len(frames),
        )
    return Corners(pixels.reshape(len(frames), 8, 2), board.marker_corners().reshape(8, 3))


def _moved(board: Board, corners: Corners, limits: BoardLimits) -> ImpossibleError | None:
    with np.errstate(invalid="ignore"):
        distance = np.linalg.norm(corners.pixels - corners.median(), axis=-1)
    seen = np.isfinite(distance).any(axis=1)
    off = np.array([np.nanmedian(d) if s else 0.0 for d, s in zip(distance, seen, strict=True)])
    typical = float(np.median(off[seen]))
    worst = int(np.argmax(off))
    if off[worst] > max(limits.moved_px, 6.0 * typical):
        return ImpossibleError(
            f"board {board.name}: photograph {worst + 1} of {len(off)} shows it {off[worst]:.1f} px off the "
            f"others, more than {limits.moved_px:g} px; it moved while it was photographed: look again once it "
            "stands still",
            board=board.name,
            photograph=worst + 1,
            off_px=float(off[worst]),
            limit_px=limits.moved_px,
        )
    return None


def _residual(corners: Corners, fit: Fit) -> float:
    """Of the median corners, without weights: a misfit that the robust fit would weigh away must be seen."""
    expected = fit.mean_px - fit.mean_residual_px
    return float(np.sqrt(np.mean((corners.median() - expected) ** 2)))


def _mean_variance(corners: Corners, fit: Fit, floor_px: float) -> float:
    """Variance of a mean corner's coordinate, px^2: never below the common part plus the frames' own over their number.

    The residuals of the mean corners (2 n - 6 degrees of freedom) see both parts; the scatter between frames only the
    second.
    """
    totals = fit.weights.sum(axis=0)
    scatter = (np.nan_to_num(corners.pixels - fit.mean_px) ** 2).sum(axis=-1)
    free = totals.sum() - np.count_nonzero(totals)
    between_frames = float((fit.weights * scatter).sum() / (2.0 * free)) if free > 0.5 else 0.0
    seen = fit.cost / (2 * len(corners.points) - 6)
    return max(seen, floor_px**2 + between_frames / max(float(totals.mean()), 1.0))


def _misfit(
    board: Board,
    corners: Corners,
    fit: Fit,
    camera: Camera,
    residual_px: float,
    floor_px: float,
    limits: BoardLimits,
) -> ImpossibleError | None:
    other = fit_marker_size(board, fit, camera, floor_px) if np.isfinite(residual_px) else None
    if (
        other is not None
        and other.rms_px < limits.residual_px
        and abs(other.size - board.marker_size) > max(limits.size_m, limits.size_sigmas * other.sigma)
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


def _ambiguous(
    board: Board, hypotheses: _Hypotheses, variance: float, limits: BoardLimits
) -> ImpossibleError | None:
    excess = (hypotheses.second.cost - hypotheses.best.cost) / variance
    if hypotheses.angle > limits.flip_rad and excess < limits.odds_log:
        return ImpossibleError(
            f"board {board.name}: its tilt cannot be told from one turned by {np.degrees(hypotheses.angle):.1f} "
            f"deg (errors differ by a factor of {hypotheses.ratio:.2f} only); more photographs, larger markers or "
            "more tilt would help",
            board=board.name,
            hypothesis_ratio=hypotheses.ratio,
            angle=hypotheses.angle,
        )
    return None
