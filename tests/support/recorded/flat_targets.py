"""Views of a small printed sheet that lies flat on a table, with the errors of paper and of printed corners."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from arm.se3 import frozen, rot_z, rotation, transform
from calib.camera.bundle_adjustment import View
from calib.camera.view_selection import TargetPhoto
from calib.model.intrinsics import camera_of
from pictures.targets import quality
from vision.targets.target import Target, TargetView

FLAT = Target("charuco", 5, 5, 0.025, 0.018, "DICT_4X4_50")
SIZE = (1920, 1200)
F_PX = 4740.0
_CAMERA = camera_of(np.array([F_PX, F_PX, 990.0, 580.0, -0.25, 0.0, 0.0, 0.0, 0.0]), SIZE)
_ABOVE = 1.19  # m
_PX_PER_M = F_PX / _ABOVE


def flat_views(
    seed: int,
    count: int = 15,
    lifts: Sequence[float] = (),
    *,
    bias_px: float = 0.15,
    warp: float = 0.2e-3,
    stretch: float = 2e-3,
    noise_px: float = 0.05,
    tilt: float = 0.028,
) -> list[View]:
    """Views of a sheet anywhere on the table, turned in its plane.

    Args:
        seed: of all errors.
        count: of views.
        lifts: height of the box under the sheet in the first views, m.
        bias_px: of each corner, common to all views.
        warp: standard deviation of a bulge of the paper, common to all views and again of each, m.
        stretch: of rows against columns, relative.
        noise_px: of each corner.
        tilt: of the table against the image about each axis, rad.
    """
    rng = np.random.default_rng(seed)
    table = rotation([*rng.normal(0.0, tilt, 2), 0.0])
    points, half = FLAT.points(), np.array([*FLAT.size, 0.0]) / 2.0
    printed = points.copy()
    printed[:, 1] = half[1] + (1.0 + rng.normal(0.0, stretch)) * (points[:, 1] - half[1])
    printed[:, :2] += rng.normal(0.0, bias_px / _PX_PER_M, (len(points), 2))
    x, y = ((points - half)[:, :2] / half[:2]).T
    bulges = np.stack([x * x, x * y, y * y], axis=-1)
    common = rng.normal(0.0, warp, 3)
    views: list[View] = []
    while len(views) < count:
        sheet = printed.copy()
        sheet[:, 2] = bulges @ (common + rng.normal(0.0, warp, 3))
        ray = np.append(_CAMERA.normalised(rng.uniform((150.0, 150.0), (1770.0, 1050.0))), 1.0)
        lift = lifts[len(views)] if len(views) < len(lifts) else 0.0
        middle = ray * (table[2, 2] * _ABOVE - lift) / (table[:, 2] @ ray)
        R = table @ rot_z(rng.uniform(-np.pi, np.pi))
        T = transform(R, middle - R @ half)
        pixels = _CAMERA.project(sheet @ R.T + T[:3, 3]) + noise_px * rng.standard_normal((len(points), 2))
        if ((pixels > 5.0) & (pixels < np.array(SIZE) - 6.0)).all():
            views.append(View(points, pixels))
    return views


def photos_of(views: Sequence[View]) -> list[TargetPhoto]:
    """Photographs 00.png, 01.png ... of these views."""
    ids, none = np.arange(FLAT.corners), np.empty(0, dtype=np.intp)
    seen = [TargetView(ids, frozen(v.pixels), frozen(np.empty((0, 4, 2))), none) for v in views]
    marked = quality(share=FLAT.marker / FLAT.square)
    return [TargetPhoto(f"{i:02d}.png", view, marked) for i, view in enumerate(seen)]
