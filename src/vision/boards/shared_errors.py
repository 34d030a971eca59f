"""Errors that a board's corners share, because they come from the print or the light of a whole marker.

A marker glued 0.07 mm off shifts its four corners together; overexposed white shifts both ends of a side. The pose
follows such errors and leaves hardly any residual, so the corner noise estimated from residuals does not include them.
Therefore each error is a column: its effect on the corners. The pose is fitted with the covariance that the columns add
(generalised least squares, A. C. Aitken, 1936).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import TOLERANCE_SDS, Board
from arm.se3 import Array, Bools, moved
from vision.boards.pose_fit import Fit
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.border_shift import moved_outwards

SAME_PRINT = 2.0  # size error of the print of both markers, in standard deviations of the tolerance
BORDER_BIAS_PX = 0.15
"""Standard deviation of a shift of all borders of a board, outwards, that `vision.markers.border_shift` leaves.

On two real prints the borders lie 0.14 and 0.17 px outwards of where the corners of the squares put them, 0.06 px from
marker to marker (docs/sources.md, "Corners in images").
"""
OWN_EDGE = 0.2  # size error of each marker alone, in the same unit
_STEPS = 5


@dataclass(frozen=True, eq=False)
class Fitted:
    """A pose fitted with shared errors.

    Attributes:
        T_camera_board: 4x4.
        covariance: (6, 6) of its twist.
        cost: squared residuals over their covariance.
        gain: twist by errors of the mean corners, (6, 16) m and rad per px.
    """

    T_camera_board: Array
    covariance: Array
    cost: float
    gain: Array


def shared_errors(board: Board, T_camera_board: Array, camera: Camera, sides_px: Array) -> Array:
    """Effect of one standard deviation of each shared error on the corners, (16, k) px; k = 0 if there is none.

    Args:
        board: with its tolerance.
        T_camera_board: rough pose.
        camera: the camera.
        sides_px: standard deviation of each side of both markers, (2, 4) px.
    """
    outlines = board.marker_corners()
    seen = Projection(camera, T_camera_board, outlines.reshape(8, 3))
    columns: list[Array] = []
    if board.tolerance > 0.0:
        sd = board.tolerance / TOLERANCE_SDS
        centred = outlines - outlines.mean(axis=1, keepdims=True)
        turned = np.stack([-centred[..., 1], centred[..., 0], 0.0 * centred[..., 0]], axis=-1)
        reach = float(np.linalg.norm(centred[0, 0]))
        in_plane = [SAME_PRINT * sd / board.marker_size * centred]
        for marker in range(2):
            own = (np.arange(2) == marker)[:, None, None]
            in_plane += [
                own * np.array(axis) * np.ones_like(centred) for axis in ((sd, 0.0, 0.0), (0.0, sd, 0.0))
            ]
            in_plane += [own * sd / reach * turned, own * OWN_EDGE * sd / board.marker_size * centred]
        columns += [np.einsum("nij,nj->ni", seen.by_point, shift.reshape(8, 3)).ravel() for shift in in_plane]
    if (sides_px > 0.0).any():
        quads = seen.pixels.reshape(2, 4, 2)
        bias = np.where((sides_px > 0.0).any(axis=1, keepdims=True), np.full((2, 4), BORDER_BIAS_PX), 0.0)
        columns.append(
            np.stack([moved_outwards(q, by) - q for q, by in zip(quads, bias, strict=True)]).ravel()
        )
        for marker, corner in enumerate(quads):
            for side in np.flatnonzero(sides_px[marker]):
                shift = np.zeros((2, 4, 2))
                shift[marker] = moved_outwards(corner, sides_px[marker] * (np.arange(4) == side)) - corner
                columns.append(shift.ravel())
    return np.stack(columns, axis=-1) if columns else np.zeros((16, 0))


@dataclass(frozen=True, eq=False)
class LeftOver:
    """Residuals in the n directions that no pose explains.

    Attributes:
        squares: squared residuals, (n,) px^2.
        shared: variance of each due to shared errors, (n,) px^2.
    """

    squares: Array
    shared: Array

    def log_likelihood(self, variance: Array) -> Array:
        """Log likelihood of variances (...) px^2 of a mean corner's coordinate."""
        total = variance[..., None] + self.shared
        return np.asarray(-0.5 * (np.log(total) + self.squares / total).sum(axis=-1))


def left_over(fit: Fit, points: Array, camera: Camera, errors: Array) -> LeftOver:
    """Separate the residuals of `fit` into directions that are independent under the shared errors (16, k) px."""
    J, r, root, used = _whitened(fit, fit.T_camera_board, points, camera)
    N = np.linalg.qr(J, mode="complete")[0][:, 6:]
    E = root[:, None] * errors[used]
    shared, V = np.linalg.eigh(N.T @ E @ E.T @ N)
    return LeftOver((V.T @ N.T @ r) ** 2, np.maximum(shared, 0.0))


def fit_with_shared(fit: Fit, points: Array, camera: Camera, errors: Array, variance: float) -> Fitted | None:
    """Refit the pose under corner noise and shared errors; None if it ends up behind the camera.

    Args:
        fit: its mean corners and shares are used, and its pose is the start.
        points: (8, 3) m.
        camera: the camera.
        errors: see `shared_errors`.
        variance: of a mean corner's coordinate, px^2.
    """
    T = fit.T_camera_board
    J, r, root, used = _whitened(fit, T, points, camera)
    E = root[:, None] * errors[used]
    W = np.linalg.inv(variance * np.eye(len(E)) + E @ E.T)
    for _ in range(_STEPS):
        step = np.linalg.solve(J.T @ W @ J, J.T @ W @ r)
        T = moved(T, step)
        J, r, _, _ = _whitened(fit, T, points, camera)
        if not np.isfinite(r).all():
            return None
    covariance = np.linalg.inv(J.T @ W @ J)
    gain = np.zeros((6, 16))
    gain[:, used] = covariance @ J.T @ W * root
    return Fitted(T, np.asarray(covariance), float(r @ W @ r), gain)


def _whitened(fit: Fit, T: Array, points: Array, camera: Camera) -> tuple[Array, Array, Array, Bools]:
    """Weighted Jacobian (n, 6) and residuals (n,) of the used coordinates, their weights (n,), and a mask (16,)."""
    used = np.repeat(fit.shares > 0.0, 2)
    root = np.sqrt(np.repeat(fit.shares, 2)[used])
    seen = Projection(camera, T, points)
    r = (fit.mean_px - seen.pixels).ravel()[used]
    return root[:, None] * seen.by_target.reshape(-1, 6)[used], root * r, root, used
