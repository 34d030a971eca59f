"""Find rejected images that fit with the target rotated: its corners were numbered from another corner."""

from __future__ import annotations

import numpy as np

from arm.se3 import Array, Indices, rot_z
from calib.chain.result import ChainCalibration

FITS = 4.0  # largest rms, in corner noise, of an image that fits when rotated
_SAME = 0.05  # of the target's size: largest distance between corresponding points


def flipped_targets(c: ChainCalibration) -> dict[int, tuple[int, ...]]:
    """Find the rejected images of the first chain that fit with their corners renumbered.

    Returns:
        By the rotation about z with which the target was detected, deg: the numbers of the images.
    """
    s = c.problem.sightings[0]
    images = c.wrong[0]
    orders = {turn: order for turn in (90, 180, 270) if (order := _order(s.points, turn)) is not None}
    if not len(images) or not orders:
        return {}
    expected = s.predicted(c.problem.camera, c.fit.unknowns, c.fit.errors[0])[images]
    noise = s.sigma(c.problem.pixel_sigma)[images]
    found: dict[int, list[int]] = {}
    for image, measured, projected, sigma in zip(images, s.pixels[images], expected, noise, strict=True):
        for turn, order in orders.items():
            rms = float(np.sqrt(np.nanmean(((measured - projected[order]) / sigma) ** 2)))
            if rms < FITS:
                found.setdefault(turn, []).append(int(image))
    return {turn: tuple(of) for turn, of in sorted(found.items())}


def _order(points: Array, turn: int) -> Indices | None:
    """Permutation of the corners under a rotation about the target's centre; None if it is not symmetric."""
    middle = points.mean(axis=0)
    there = (points - middle) @ rot_z(np.radians(turn)).T + middle
    off = np.linalg.norm(there[:, None] - points, axis=-1)
    order = off.argmin(axis=1)
    size = float(np.ptp(points, axis=0).max())
    if off.min(axis=1).max() > _SAME * size or len(np.unique(order)) < len(order):
        return None
    return np.asarray(order)
