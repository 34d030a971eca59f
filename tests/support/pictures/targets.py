"""Views of a calibration target before the lab's camera: corners with stated noise, without an image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, frozen
from calib.camera.bundle_adjustment import Bundle, View, adjust
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import COUNT, camera_of, vector_of
from cell.sim.target_photos import corners_in_view, random_poses
from pictures.boards import lab_camera
from vision.camera.model import Camera
from vision.targets.quality import Quality
from vision.targets.target import Target, TargetView

CHARUCO = Target()
NOISE_PX = 0.03
SIZE = (1920, 1200)
ALL = np.ones(COUNT, dtype=bool)


@lru_cache(maxsize=1)
def camera() -> Camera:
    """The lab's camera."""
    return lab_camera()


def poses(seed: int, count: int = 20, tilt: float = 0.5) -> list[Array]:
    """Poses of the default target that fill the image."""
    return random_poses(camera(), CHARUCO, np.random.default_rng(seed), count, tilt=tilt)


def seen(
    T_camera_target: Array,
    rng: np.random.Generator,
    noise_px: float = NOISE_PX,
    shape: Callable[[Array], Array] = lambda points: points,
    lens: Camera | None = None,
) -> TargetView:
    """The corners of the default target that a camera sees, displaced by `shape` in its frame, with noise."""
    lens = lens or camera()
    ids = np.flatnonzero(corners_in_view(lens, CHARUCO, T_camera_target))
    points = shape(CHARUCO.points()[ids]) @ T_camera_target[:3, :3].T + T_camera_target[:3, 3]
    pixels = lens.project(points)
    return TargetView(
        ids,
        frozen(pixels + noise_px * rng.standard_normal(pixels.shape)),
        frozen(np.empty((0, 4, 2))),
        np.empty(0, dtype=np.intp),
    )


def quality(
    blur_px: float = 0.8, contrast: float = 180.0, saturated: float = 0.0, share: float = 22 / 30
) -> Quality:
    """A photograph's quality, good by default."""
    return Quality(blur_px, contrast, saturated, share)


def photos(views: Sequence[TargetView], marked: Quality | None = None) -> list[TargetPhoto]:
    """Photographs 00.png, 01.png ... of these views."""
    return [TargetPhoto(f"{i:02d}.png", view, marked or quality()) for i, view in enumerate(views)]


def views_of(found: Sequence[TargetView]) -> list[View]:
    """What an adjustment takes."""
    return [View(CHARUCO.points()[view.ids], view.corners_px) for view in found]


def bent(sagitta: float) -> Callable[[Array], Array]:
    """A target whose middle stands out by `sagitta` m against its left and right edges."""
    half = CHARUCO.size[0] / 2.0

    def shape(points: Array) -> Array:
        away = points.copy()
        away[:, 2] += sagitta * ((points[:, 0] / half - 1.0) ** 2 - 1.0)
        return away

    return shape


def taken(seed: int, count: int = 14, tilt: float = 0.5, **how: Any) -> list[TargetView]:
    """Views with noise; `how` goes to `seen`."""
    rng = np.random.default_rng(seed)
    return [seen(T, rng, **how) for T in poses(seed, count, tilt)]


def fitted(
    seed: int, noise_px: float = NOISE_PX, free: npt.NDArray[np.bool_] = ALL
) -> tuple[list[View], Bundle]:
    """Views with noise, and the intrinsics and poses that fit them; what is not free is zero."""
    rng = np.random.default_rng(seed)
    placed = poses(seed)
    views = views_of([seen(T, rng, noise_px) for T in placed])
    begun = camera_of(np.where(free, vector_of(camera()), 0.0), camera().size)
    return views, adjust(views, begun, placed, free)
