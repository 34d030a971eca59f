"""Initial intrinsics and poses: try a few focal lengths and keep the best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.camera.bundle_adjustment import Bundle, View, adjust
from calib.model.intrinsics import pinhole
from vision.boards.pose_fit import STEP_DONE, Corners, Fit, fit_weighted, planar_poses
from vision.camera.model import Camera

ROUGH = 1e-3  # relative change of the cost at which to stop
MOST_VIEWS = 8  # used to choose the focal length
FOCAL_LENGTHS = (0.7, 1.2, 2.0, 3.5, 6.0)  # in image widths, from wide angle to telephoto
MOST_STARTS = 2  # focal lengths whose poses fit best, from which intrinsics are adjusted
NEAR = 1e-4  # m and rad, last step of poses that are adjusted next
_PINHOLE = np.array([True, True, True, True, False, False, False, False, False])


def pose_of(view: View, camera: Camera, done: float = STEP_DONE) -> Array:
    """Return T_camera_target (4x4) of a view for given intrinsics: the better of both planar solutions, refined.

    Args:
        view: of the target.
        camera: intrinsics.
        done: step at which to stop, m and rad.
    """
    return _fitted(view, camera, done).T_camera_board


def _fitted(view: View, camera: Camera, done: float) -> Fit:
    corners, weights = Corners(view.pixels[None], view.points), np.ones((1, len(view.points)))
    starts = planar_poses(view.pixels, view.points, camera)
    fits = [fit_weighted(corners, weights, start, camera, done=done) for start in starts]
    return min(fits, key=_cost)


def _cost(fit: Fit) -> float:
    return fit.cost if np.isfinite(fit.cost) else np.inf


def initial_guess(views: Sequence[View], size: tuple[int, int]) -> Bundle:
    """Return a pinhole camera and poses that roughly fit the views.

    Adjusting ends at the same pinhole camera from almost every focal length, but the prior stays about the start. So
    only the starts whose poses fit best are adjusted.

    Raises:
        CalibrationRefused: no focal length fits.
    """
    some = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).astype(int))]
    found: list[Bundle] = []
    for camera, poses in _starts(some, size):
        try:
            bundle = adjust(some, camera, poses, _PINHOLE, done=ROUGH)
        except (CalibrationRefused, np.linalg.LinAlgError):
            continue
        if np.isfinite(bundle.squares) and bundle.camera.K[0, 0] > 0.0:
            found.append(bundle)
        if len(found) == MOST_STARTS:
            break
    if not found:
        raise CalibrationRefused(
            "no focal length between 0.7 and 6 image widths fits the views; are all from one camera, and is the "
            "target as its file describes?",
            reason="start",
        )
    best = min(found, key=lambda bundle: bundle.squares)
    poses = [pose_of(view, best.camera, NEAR) for view in views]
    return adjust(views, best.camera, poses, _PINHOLE, best.prior, done=ROUGH)


def _starts(views: Sequence[View], size: tuple[int, int]) -> list[tuple[Camera, list[Array]]]:
    """A camera of each focal length with the poses of the views, best fit first."""
    tried: list[tuple[float, Camera, list[Array]]] = []
    for f in np.multiply(FOCAL_LENGTHS, size[0]):
        camera = pinhole(f, size)
        try:
            fits = [_fitted(view, camera, NEAR) for view in views]
        except np.linalg.LinAlgError:
            continue
        tried.append((sum(_cost(fit) for fit in fits), camera, [fit.T_camera_board for fit in fits]))
    return [(camera, poses) for _, camera, poses in sorted(tried, key=lambda one: one[0])]
