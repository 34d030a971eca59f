"""Initial intrinsics and poses: try a few focal lengths and keep the best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.errors import CalibrationRefused
from arm.se3 import Array
from calib.camera.bundle_adjustment import Bundle, View, adjust
from calib.model.intrinsics import camera_of
from vision.boards.pose_fit import Corners, fit_weighted, planar_poses
from vision.camera.model import Camera

ROUGH = 1e-3  # relative change of the cost at which to stop
MOST_VIEWS = 8  # used to choose the focal length
FOCAL_LENGTHS = (0.7, 1.2, 2.0, 3.5, 6.0)  # in image widths, from wide angle to telephoto
_PINHOLE = np.array([True, True, True, True, False, False, False, False, False])


def pose_of(view: View, camera: Camera) -> Array:
    """Return T_camera_target (4x4) of a view for given intrinsics: the better of both planar solutions, refined."""
    corners, weights = Corners(view.pixels[None], view.points), np.ones((1, len(view.points)))
    starts = planar_poses(view.pixels, view.points, camera)
    fits = [fit_weighted(corners, weights, start, camera) for start in starts]
    return min(fits, key=lambda fit: fit.cost if np.isfinite(fit.cost) else np.inf).T_camera_board


def initial_guess(views: Sequence[View], size: tuple[int, int]) -> Bundle:
    """Return a pinhole camera and poses that roughly fit the views.

    Raises:
        CalibrationRefused: no focal length fits.
    """
    some = [views[i] for i in np.unique(np.linspace(0, len(views) - 1, MOST_VIEWS).astype(int))]
    tried: list[Bundle] = []
    for f in np.multiply(FOCAL_LENGTHS, size[0]):
        camera = camera_of(np.array([f, f, (size[0] - 1) / 2.0, (size[1] - 1) / 2.0, *np.zeros(5)]), size)
        try:
            poses = [pose_of(view, camera) for view in some]
            bundle = adjust(some, camera, poses, _PINHOLE, done=ROUGH)
        except (CalibrationRefused, np.linalg.LinAlgError):
            continue
        if np.isfinite(bundle.squares) and bundle.camera.K[0, 0] > 0.0:
            tried.append(bundle)
    if not tried:
        raise CalibrationRefused(
            "no focal length between 0.7 and 6 image widths fits the views; are all from one camera, and is the "
            "target as its file describes?",
            reason="start",
        )
    best = min(tried, key=lambda bundle: bundle.squares)
    poses = [pose_of(view, best.camera) for view in views]
    return adjust(views, best.camera, poses, _PINHOLE, best.prior, done=ROUGH)
