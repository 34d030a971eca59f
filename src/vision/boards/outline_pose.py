"""Estimate the pose of a board from what shows of its markers and from its outline, or refuse it.

One marker alone hardly determines a board's tilt, and confuses the pose with its mirror image. The outline of a light
plate on darker ground is several markers wide, and its far sides determine both. Corners of the markers and lines of
the sides are fitted together (generalised least squares) under all that may be wrong with either: noise, print, light,
the outline's tolerance. The pose is used only if at least two adjacent sides show, if everything fits, if the mirrored
pose does not, and if no other board with the same markers is in view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc

from arm.board import TOLERANCE_SDS, Board
from arm.errors import ImpossibleError
from arm.poses import BoardPose
from arm.se3 import Array, angle_between, frozen, inverse, moved
from vision.boards import checks
from vision.boards.copies import other_copy
from vision.boards.outline import LEAST_SEEN, SIDES, Side, find_sides, meet
from vision.boards.pose import COMMON_MODE_PX, RATIO_CAP, BoardAssessment, BoardLimits
from vision.boards.pose_fit import planar_poses
from vision.boards.shared_errors import shared_errors
from vision.boards.tilt_prior import tilt_hypothesis
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.detect import Marker
from vision.markers.edge_profiles import Grey

REACHES = (3e-3, 2e-3, 1e-3, 1e-3)
"""Distances within which sides are looked for, one round after the other, m: less than from a marker to its side."""
OUTWARDS_PX = 0.2  # standard deviation of a shift of all sides by light and blur, outwards
MISFIT = 1e-3  # probability below which markers and outline are not those of one board
SHAPE = 0.05e-3  # standard deviation of each corner of a marker as printed, m: a real 3D print has 0.04 mm
_STEPS, _DONE = 30, 1e-9  # of a fit; m and rad
_MEDIAN = np.pi / 2.0  # variance of a median over that of a mean


@dataclass(frozen=True, eq=False)
class _Seen:
    """What shows of a board's markers.

    Attributes:
        board: the board.
        numbers: of its markers that show, 0 or 1 or both.
        corners_px: of these, (4 m, 2) px.
        noise: their covariance, (8 m, 8 m) px^2.
        sides_px: standard deviations of the sides of both markers, 0 for one that does not show, (2, 4) px.
    """

    board: Board
    numbers: tuple[int, ...]
    corners_px: Array
    noise: Array
    sides_px: Array

    @property
    def points(self) -> Array:
        """The corners on the board, (4 m, 3) m."""
        return np.asarray(self.board.marker_corners()[list(self.numbers)].reshape(-1, 3))

    @property
    def words(self) -> str:
        """Which markers, for a message."""
        ids = [str(self.board.marker_ids[k]) for k in self.numbers]
        return f"marker {ids[0]} alone" if len(ids) == 1 else f"markers {' and '.join(ids)}"


@dataclass(frozen=True, eq=False)
class _Joint:
    """A pose fitted to markers and sides.

    Attributes:
        T: T_camera_board, 4x4.
        covariance: (6, 6) of its twist.
        repeatability: the part of it that is new in each image, (6, 6).
        cost: squared residuals over their covariance.
        freedom: degrees of freedom of `cost`.
        residual_px: root mean square of the corners' residuals, per coordinate.
        sides: those used.
    """

    T: Array
    covariance: Array
    repeatability: Array
    cost: float
    freedom: int
    residual_px: float
    sides: tuple[Side, ...]

    @property
    def fits(self) -> bool:
        """Whether the residuals are as small as their covariance says."""
        return bool(chdtrc(self.freedom, self.cost) > MISFIT and self.residual_px <= checks.RESIDUAL_PX)


def assess_with_outline(
    board: Board,
    frames: Sequence[Sequence[Marker]],
    image: Grey,
    camera: Camera,
    dictionary: str,
    limits: BoardLimits | None = None,
    tilts: Sequence[float] = (),
    others: Sequence[int] = (),
) -> BoardAssessment:
    """Estimate the pose of a board from its markers, one or both, and its outline, and collect doubts.

    Args:
        board: with an outline; at least one of its markers is in `frames`.
        frames: the markers of each image of a cell at rest.
        image: mean of these images, (h, w).
        camera: intrinsics and extrinsics.
        dictionary: of the markers.
        limits: for doubts.
        tilts: known tilts of the stands, rad, which are compared with the pose and change nothing.
        others: ids of markers of other boards that may be in view.
    """
    seen = _gather(board, frames)
    if isinstance(seen, ImpossibleError):
        return BoardAssessment(None, (seen,))
    starts = planar_poses(seen.corners_px, seen.points, camera)
    tried = [_settled(seen, start, image, camera) for start in starts]
    found = [joint for joint in tried if isinstance(joint, _Joint)]
    if not found:
        return BoardAssessment(None, (_unconfirmed(seen, tried),))
    found.sort(key=lambda joint: (not joint.fits, -len(joint.sides), round(joint.cost, 6)))
    best, *rest = found
    if not best.fits:
        return BoardAssessment(None, (_misfit(seen, best, camera),))
    # the mirrored pose is fitted to the same lines, and may have found as many lines of its own
    rest = [joint for joint in rest if joint.fits and len(joint.sides) == len(best.sides)]
    rest += [again for start in starts if (again := _fit(seen, best.sides, start, camera))]
    mirrored = [(joint.cost, angle_between(best.T[:3, :3], joint.T[:3, :3])) for joint in rest]
    cost, angle = min((m for m in mirrored if m[1] > checks.FLIP), default=(np.inf, 0.0))
    ratio = float(np.clip(np.sqrt(cost / max(best.cost, 1e-12)), 1.0, RATIO_CAP))
    pose = BoardPose(
        board,
        frozen(camera.T_base_camera @ best.T),
        frozen(best.covariance),
        best.residual_px,
        ratio,
        repeatability=frozen(best.repeatability),
    )
    if tilts:
        pose = replace(pose, tilt_hypothesis=tilt_hypothesis(pose, tilts))
    twice = other_copy(image, board, best.T, camera, dictionary, others)
    doubts = [
        *([] if twice is None else [twice]),
        *checks.ambiguous(board, angle, (cost - best.cost) / 2.0, ratio),
        *checks.uncertain(pose, limits or BoardLimits()),
    ]
    return BoardAssessment(pose, tuple(doubts))


def _gather(board: Board, frames: Sequence[Sequence[Marker]]) -> _Seen | ImpossibleError:
    twice = checks.seen_twice(board, frames)
    if twice is not None:
        return twice
    numbers, corners, noises, sides = [], [], [], np.zeros((2, 4))
    for number, marker_id in enumerate(board.marker_ids):
        of_id = [m for frame in frames for m in frame if m.id == marker_id]
        if not of_id:
            continue
        whole = [m for m in of_id if m.method == "lines"]
        if 2 * len(whole) <= len(frames):
            return ImpossibleError(
                f"board {board.name}: all four borders of marker {marker_id} show in {len(whole)} of {len(frames)} "
                "images; to be used with the outline, a marker must be whole and sharp in more than half: uncover it",
                board=board.name,
                marker=marker_id,
            )
        pixels = np.array([m.corners_px for m in whole])
        middle = np.median(pixels, axis=0)
        off = float(np.linalg.norm(pixels - middle, axis=-1).max())
        if off > checks.MOVED_PX:
            return ImpossibleError(
                f"board {board.name}: a corner of marker {marker_id} is {off:.1f} px off the other images, more than "
                f"{checks.MOVED_PX:g} px; the board moved between images: look again once it is at rest",
                board=board.name,
                marker=marker_id,
                off_px=off,
            )
        rough = COMMON_MODE_PX["subpix"] ** 2 * np.eye(8)
        noise = np.mean([rough if m.noise is None else m.noise for m in whole], axis=0)
        numbers.append(number)
        corners.append(middle)
        noises.append((_MEDIAN if len(whole) > 2 else 1.0) / len(whole) * noise)
        sigmas = [m.side_sigma_px for m in whole if m.side_sigma_px is not None]
        if sigmas:  # the light is the same in all images
            sides[number] = np.sqrt(np.mean(np.square(sigmas), axis=0))
    return _Seen(board, tuple(numbers), np.concatenate(corners), np.asarray(block_diag(*noises)), sides)


def _settled(seen: _Seen, T: Array, image: Grey, camera: Camera) -> _Joint | list[Side]:
    """Look for sides and fit, in turns; if too few of them confirm the pose, return what was found of them."""
    joint = None
    for reach in REACHES:
        sides = find_sides(image, seen.board, T, camera, reach)
        confirmed = tuple(side for side in sides if side.confirms)
        if not meet(confirmed):
            return sides
        joint = _fit(seen, confirmed, T, camera)
        if joint is None:
            return sides
        T = joint.T
    return [] if joint is None else joint


def _fit(seen: _Seen, sides: tuple[Side, ...], T: Array, camera: Camera) -> _Joint | None:
    """Fit the pose near `T` (Levenberg-Marquardt); None if it ends up behind the camera."""
    damping, r = 1e-6, _residuals(seen, sides, T, camera)
    if not np.isfinite(r).all():
        return None
    W = _weights(seen, sides, T, camera)
    for _ in range(_STEPS):
        J = _by_pose(seen, sides, T, camera)
        H = J.T @ W @ J
        step = np.linalg.solve(H + damping * np.diag(np.diag(H)), J.T @ W @ r)
        candidate = moved(T, step)
        then = _residuals(seen, sides, candidate, camera)
        if then @ W @ then <= r @ W @ r:  # NaN behind the camera compares false
            T, r, damping = candidate, then, 0.1 * damping
        else:
            damping *= 10.0
        if np.abs(step).max() < _DONE or damping > 1e6:
            break
    W, J = _weights(seen, sides, T, camera), _by_pose(seen, sides, T, camera)
    covariance = np.asarray(np.linalg.inv(J.T @ W @ J))
    gain = covariance @ J.T @ W
    rms = float(np.sqrt(np.mean(r[: seen.corners_px.size] ** 2)))
    return _Joint(
        T, covariance, gain @ _noise(seen, sides) @ gain.T, float(r @ W @ r), len(r) - 6, rms, sides
    )


def _weights(seen: _Seen, sides: Sequence[Side], T: Array, camera: Camera) -> Array:
    """Inverse of the covariance of what is seen, px^-2."""
    E = _errors(seen, sides, T, camera)
    return np.asarray(np.linalg.inv(_noise(seen, sides) + E @ E.T))


def _noise(seen: _Seen, sides: Sequence[Side]) -> Array:
    """Covariance of what is seen that other images would draw anew, px^2."""
    return np.asarray(block_diag(seen.noise, *(side.noise for side in sides)))


def _residuals(seen: _Seen, sides: Sequence[Side], T: Array, camera: Camera) -> Array:
    """Of the corners along x and y, and of both points of each side across it, (8 m + 2 n,) px."""
    corners = (seen.corners_px - Projection(camera, T, seen.points).pixels).ravel()
    across = [(s.inwards * (s.found_px - Projection(camera, T, s.points).pixels)).sum(axis=-1) for s in sides]
    return np.concatenate([corners, *across])


def _by_pose(seen: _Seen, sides: Sequence[Side], T: Array, camera: Camera) -> Array:
    """Derivative of what is seen by the board's twist, (8 m + 2 n, 6)."""
    corners = Projection(camera, T, seen.points).by_target.reshape(-1, 6)
    across = [np.einsum("ni,nij->nj", s.inwards, Projection(camera, T, s.points).by_target) for s in sides]
    return np.concatenate([corners, *across])


def _errors(seen: _Seen, sides: Sequence[Side], T: Array, camera: Camera) -> Array:
    """Effect of one standard deviation of each error of print, light and outline, (8 m + 2 n, k) px."""
    board = seen.board
    rows = np.arange(16).reshape(2, 8)[list(seen.numbers)].ravel()
    of_markers = shared_errors(board, T, camera, seen.sides_px)[rows]
    px_per_m = float(np.linalg.norm(seen.corners_px[1] - seen.corners_px[0])) / board.marker_size
    own = np.hypot(SHAPE * px_per_m, COMMON_MODE_PX["lines"]) * np.eye(len(rows))
    of_sides = _side_errors(board, sides, T, camera)
    return np.asarray(block_diag(np.hstack([of_markers, own]), of_sides))


def _side_errors(board: Board, sides: Sequence[Side], T: Array, camera: Camera) -> Array:
    """Effect on the sides of their corners' tolerance, of light, and of the plate's thickness, (2 n, k) px."""
    sd = 0.0 if board.outline is None else board.outline.tolerance / TOLERANCE_SDS
    eye = inverse(T)[:3, 3]
    blocks = []
    for side in sides:
        edge = side.points[1] - side.points[0]
        outward = np.array([-edge[1], edge[0], 0.0]) / np.linalg.norm(edge)
        seen = Projection(camera, T, side.points)
        px_per_m = np.einsum("ni,nij,j->n", side.inwards, seen.by_point, outward)
        # a camera that sees the plate's edge may take its lower rim for the upper one
        slope = max(float(outward @ (eye - side.points.mean(axis=0))), 0.0) / eye[2]
        rim = board.plate.size[2] * slope / np.sqrt(3.0)
        blocks.append(
            np.stack([sd * (1.0 - side.along), sd * side.along, np.full(2, rim)], -1) * px_per_m[:, None]
        )
    light = np.full((2 * len(sides), 1), OUTWARDS_PX)
    return np.hstack([np.asarray(block_diag(*blocks)), light])


def _unconfirmed(seen: _Seen, tried: Sequence[_Joint | list[Side]]) -> ImpossibleError:
    """Say what of the outline shows, for the solution near which most of it does."""
    each = [t for t in tried if not isinstance(t, _Joint)]
    most = max(each, key=lambda sides: sum(side.seen for side in sides), default=[])
    shares = {SIDES[side.index]: side.seen for side in most}
    words = ", ".join(f"{name} {100 * shares.get(name, 0.0):.0f} %" for name in SIDES)
    return ImpossibleError(
        f"board {seen.board.name}: its outline does not confirm the pose from {seen.words}: of its sides show {words} "
        f"(with marker {seen.board.marker_ids[0]} upright), and of two adjacent ones {100 * LEAST_SEEN:g} % must show; "
        "uncover the markers or more of the sides",
        board=seen.board.name,
        seen=shares,
    )


def _misfit(seen: _Seen, joint: _Joint, camera: Camera) -> ImpossibleError:
    """Say by how much the worst side is off."""
    r = _residuals(seen, joint.sides, joint.T, camera)[seen.corners_px.size :].reshape(-1, 2)
    side_px = float(np.linalg.norm(seen.corners_px[1] - seen.corners_px[0]))
    off = np.abs(r).max(axis=1) * seen.board.marker_size / side_px
    worst = int(np.argmax(off))
    name = SIDES[joint.sides[worst].index]
    return ImpossibleError(
        f"board {seen.board.name}: {seen.words} and the outline do not fit one board: its {name} side is "
        f"{1e3 * off[worst]:.1f} mm off; check size_mm, outline_mm and outline_within_mm of its file",
        board=seen.board.name,
        side=name,
        off=float(off[worst]),
    )
