"""Estimate a board's pose jointly from both markers and all frames, with a realistic covariance, or refuse it.

Fusing all corners in one fit reaches the Cramer-Rao bound; a median of poses or of corners wastes 20-40 % of the
information, and one marker alone flips its tilt (docs/sources.md, "Pose of a board").

The covariance includes noise of the corners (`vision.boards.corner_noise`), and print and light of each marker
(`vision.boards.shared_errors`). `vision.observe` adds the uncertainty of the camera's present shift, `BoardPose.holes`
the plate's tolerance. It does not include lens and extrinsics; allow for them in `motion.clearance_mm`
(docs/real-cell.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from arm.board import Board
from arm.errors import ImpossibleError
from arm.former import former_names
from arm.poses import BoardPose
from arm.se3 import Array, angle_between, frozen
from vision.boards import checks
from vision.boards.checks import BoardLimits
from vision.boards.corner_noise import mean_corner_variance
from vision.boards.marker_size import DETERMINED
from vision.boards.pose_fit import (
    Corners,
    Fit,
    fit_again,
    fit_pose,
    frame_variance,
    planar_poses,
)
from vision.boards.shared_errors import Fitted, fit_with_shared, left_over, shared_errors
from vision.boards.tilt_prior import log_odds_of_tilts, tilt_hypothesis
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.detect import Marker

__all__ = ["BoardAssessment", "BoardLimits", "assess_board", "estimate_board_pose"]

COMMON_MODE_PX = {"lines": 0.02, "subpix": 0.15, "recorded": 0.02}
"""Smallest corner error common to all frames: light, blur, distortion. More frames do not average it out."""
SMALL_SUBPIX = 0.35
"""The same of "subpix" on markers smaller than `SMALL_PX`, whose code is within its window.

Poses of real markers of 20 to 30 px were off by 1.44 times their standard deviations with 0.15 px, 1.23 times with this
(bench/results/public-markers-2026-11-24.md).
"""
SMALL_PX = 50.0  # shortest side
MERGED_RAD = 1e-3  # solutions that differ by less are one solution
RATIO_CAP = 1e3  # largest `BoardPose.hypothesis_ratio`; also its value without a second solution


@dataclass(frozen=True, eq=False)
class BoardAssessment:
    """A board's pose, and the doubts about it.

    Attributes:
        pose: the best estimate, even if doubtful; None if there is none.
        doubts: why it must not be used, each with its data; empty if it may.
    """

    pose: BoardPose | None
    doubts: tuple[ImpossibleError, ...]

    @property
    def accepted(self) -> bool:
        """Whether the pose may be used."""
        return self.pose is not None and not self.doubts


def estimate_board_pose(
    board: Board,
    frames: Sequence[Sequence[Marker]],
    camera: Camera,
    limits: BoardLimits | None = None,
    tilts: Sequence[float] = (),
) -> BoardPose:
    """Run `assess_board` and raise its first doubt.

    Raises:
        ImpossibleError: a marker is in no frame, or twice in one; the board moved between frames, another marker size
            fits, the corners do not fit the board, its tilt cannot be distinguished from the mirrored one, or the pose
            is less certain than the limits allow.
    """
    return accepted_pose(board, assess_board(board, frames, camera, limits, tilts))


def accepted_pose(board: Board, assessment: BoardAssessment) -> BoardPose:
    """Return the pose of an assessment, or raise its first doubt.

    Raises:
        ImpossibleError: the pose is doubted, or there is none.
    """
    for doubt in assessment.doubts:
        raise doubt
    if assessment.pose is None:
        raise ImpossibleError(f"board {board.name}: its markers' corners fit no pose", board=board.name)
    return assessment.pose


def assess_board(
    board: Board,
    frames: Sequence[Sequence[Marker]],
    camera: Camera,
    limits: BoardLimits | None = None,
    tilts: Sequence[float] = (),
) -> BoardAssessment:
    """Estimate the pose of a board from the markers in each frame, and collect doubts.

    Args:
        board: whose markers are used; others are ignored.
        frames: the markers of each image of a cell at rest.
        camera: intrinsics and extrinsics.
        limits: for doubts.
        tilts: known tilts of the board stands from the vertical, rad, tested as a hypothesis. They help to choose
            between the two planar solutions if the images alone do not decide, and change neither pose.
    """
    limits = limits or BoardLimits()
    corners = _gather(board, frames)
    if isinstance(corners, ImpossibleError):
        return BoardAssessment(None, (corners,))
    hypotheses = _Hypotheses.of(corners, camera)
    if not hypotheses.best.valid:
        return BoardAssessment(None, (*checks.moved(board, corners), checks.no_pose(board, corners, camera)))
    floor = max(_common_mode(m) for frame in frames for m in frame if m.id in board.marker_ids)
    both = (hypotheses.best, hypotheses.second)
    errors = [_shared(board, fit, frames, camera) for fit in both]
    left = None if errors[0] is None else left_over(hypotheses.best, corners.points, camera, errors[0])
    noise = _noise(board, frames, corners, hypotheses.best)
    # one image has no scatter between images: its corners' own noise is the least that residuals may stand for
    least = (
        floor if len(frames) > 1 or noise is None else float(np.hypot(floor, np.sqrt(np.diag(noise).mean())))
    )
    variance = mean_corner_variance(corners, hypotheses.best, least, left)
    fits = [_fitted(fit, corners, camera, variance, e) for fit, e in zip(both, errors, strict=True)]
    poses = [
        _pose(board, f, fit, corners, camera, hypotheses.ratio, noise)
        for f, fit in zip(fits, both, strict=True)
    ]
    costs = [fit.cost / variance if f is None else f.cost for f, fit in zip(fits, both, strict=True)]
    log_odds = (costs[1] - costs[0]) / 2.0
    tilt_log_odds = 0.0
    angle = _angle(fits, hypotheses)
    undecided = angle > checks.FLIP and log_odds < checks.LOG_ODDS
    if tilts and undecided and poses[0] is not None and poses[1] is not None:
        tilt_log_odds = log_odds_of_tilts(poses[0], poses[1], tilts)
    first = angle <= MERGED_RAD or log_odds + tilt_log_odds >= 0.0
    chosen, pose = (hypotheses.best, poses[0]) if first else (hypotheses.second, poses[1])
    residual_px = float(np.sqrt(np.mean(chosen.mean_residual_px[chosen.shares > 0.0] ** 2)))
    doubts = list(checks.moved(board, corners))
    doubts += checks.misfit(board, corners, chosen, camera, residual_px, floor)
    # A pose that does not fit says nothing of its tilt or its uncertainty.
    if residual_px <= checks.RESIDUAL_PX:
        odds = abs(log_odds + tilt_log_odds)
        doubts += checks.ambiguous(board, angle, odds, hypotheses.ratio)
        doubts += [] if pose is None else checks.uncertain(pose, limits)
    if pose is not None and tilts:
        pose = replace(pose, tilt_hypothesis=tilt_hypothesis(pose, tilts))
    return BoardAssessment(pose, tuple(doubts))


def _common_mode(marker: Marker) -> float:
    sides = np.linalg.norm(marker.corners_px - np.roll(marker.corners_px, 1, axis=0), axis=1)
    small = marker.method == "subpix" and sides.min() < SMALL_PX
    return SMALL_SUBPIX if small else COMMON_MODE_PX[marker.method]


def _angle(fits: Sequence[Fitted | None], hypotheses: _Hypotheses) -> float:
    """Angle between the two solutions, rad; 0 if, with shared errors, both end up in the first one."""
    first, second = fits
    if first is None or second is None:
        return hypotheses.angle
    ends = (first.T_camera_board, hypotheses.best.T_camera_board, hypotheses.second.T_camera_board)
    apart, from_best, from_second = (
        angle_between(end[:3, :3], second.T_camera_board[:3, :3]) for end in ends
    )
    return 0.0 if apart <= checks.FLIP and from_best < from_second else float(apart)


def _shared(board: Board, fit: Fit, frames: Sequence[Sequence[Marker]], camera: Camera) -> Array | None:
    """Effect of the errors that corners share, (16, k) px; None if there are no such errors, or no pose."""
    if not fit.valid:
        return None
    sides = np.zeros((2, 4))
    markers = [m for frame in frames for m in frame]
    for row, marker_id in zip(sides, board.marker_ids, strict=True):
        squares = [m.side_sigma_px**2 for m in markers if m.id == marker_id and m.side_sigma_px is not None]
        if squares:  # the light is the same in all images
            row[:] = np.sqrt(np.mean(squares, axis=0))
    errors = shared_errors(board, fit.T_camera_board, camera, sides)
    return errors if errors.shape[1] and np.isfinite(errors).all() else None


def _fitted(
    fit: Fit, corners: Corners, camera: Camera, variance: float, errors: Array | None
) -> Fitted | None:
    """The pose and its covariance; None if the corners do not determine it."""
    J = Projection(camera, fit.T_camera_board, corners.points).by_target
    information = np.einsum("n,nia,nib->ab", fit.shares, J, J)
    if not np.isfinite(information).all() or not np.isfinite(variance):
        return None
    least, *_, most = np.linalg.eigvalsh(information)
    if least < DETERMINED * most:
        return None
    if errors is not None:
        return fit_with_shared(fit, corners.points, camera, errors, variance)
    inverse_information = np.linalg.inv(information)
    gain = inverse_information @ (np.repeat(fit.shares, 2)[:, None] * J.reshape(-1, 6)).T
    return Fitted(fit.T_camera_board, variance * inverse_information, fit.cost / variance, gain)


def _noise(board: Board, frames: Sequence[Sequence[Marker]], corners: Corners, fit: Fit) -> Array | None:
    """Covariance of the mean corners that other images would draw anew, (16, 16) px^2; None if unknown."""
    of_frames = frame_variance(corners, fit)
    if of_frames is not None:
        totals = np.repeat(fit.weights.sum(axis=0), 2)
        return np.diag(of_frames / np.maximum(totals, 1e-9))
    markers = {m.id: m for frame in frames for m in frame}
    first, second = (markers[i].noise for i in board.marker_ids)
    return None if first is None or second is None else block_diag(first, second)


def _pose(
    board: Board,
    fitted: Fitted | None,
    fit: Fit,
    corners: Corners,
    camera: Camera,
    ratio: float,
    noise: Array | None,
) -> BoardPose | None:
    if fitted is None:
        return None
    return BoardPose(
        board,
        frozen(camera.T_base_camera @ fitted.T_camera_board),
        frozen(fitted.covariance),
        _residual(corners, fit),
        ratio,
        repeatability=None if noise is None else frozen(fitted.gain @ noise @ fitted.gain.T),
    )


@dataclass(frozen=True)
class _Hypotheses:
    """Both planar solutions, with the weights of the better one; the rotation between them, rad; ratio of residuals."""

    best: Fit
    second: Fit
    angle: float
    ratio: float

    @classmethod
    def of(cls, corners: Corners, camera: Camera) -> _Hypotheses:
        starts = planar_poses(corners.median(), corners.points, camera)
        best = fit_pose(corners, starts[0], camera)
        second = fit_again(best, corners.points, starts[-1], camera)
        if second.cost < best.cost:
            best = fit_pose(corners, second.T_camera_board, camera)
            second = fit_again(best, corners.points, starts[0], camera)
        angle = angle_between(best.T_camera_board[:3, :3], second.T_camera_board[:3, :3])
        merged = angle < MERGED_RAD
        ratio = RATIO_CAP if merged else float(np.sqrt(second.cost / max(best.cost, 1e-12)))
        return cls(best, second, angle, float(np.clip(ratio, 1.0, RATIO_CAP)))


def _residual(corners: Corners, fit: Fit) -> float:
    """Rms residual, including corners that the fit rejected in all frames, px."""
    rejected = (fit.shares == 0.0)[:, None]
    projected = fit.mean_px - fit.mean_residual_px
    residual = np.where(rejected, corners.median() - projected, fit.mean_residual_px)
    return float(np.sqrt(np.mean(residual**2)))


def _gather(board: Board, frames: Sequence[Sequence[Marker]]) -> Corners | ImpossibleError:
    pixels = np.full((len(frames), 2, 4, 2), np.nan)
    twice = checks.seen_twice(board, frames)
    if twice is not None:
        return twice
    for index, frame in enumerate(frames):
        for marker in frame:
            if marker.id in board.marker_ids:
                pixels[index, board.marker_ids.index(marker.id)] = marker.corners_px
    detected = np.isfinite(pixels).all(axis=(2, 3)).any(axis=0)
    if not detected.all():
        missing = [i for i, there in zip(board.marker_ids, detected, strict=True) if not there]
        names = " and ".join(map(str, missing))
        return ImpossibleError(
            f"board {board.name}: marker {names} is in none of {len(frames)} images; the pose needs both, because "
            "one marker alone flips its tilt; uncover it or move the board into view",
            board=board.name,
            missing=missing,
            photographs=len(frames),
        )
    return Corners(pixels.reshape(len(frames), 8, 2), board.marker_corners().reshape(8, 3))


former_names(__name__, __name__, BoardSeen="BoardAssessment")
