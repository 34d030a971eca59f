"""Wrong images that are right ones of a target taken for turned: its corners were counted from another one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, rot_z
from calib.chain.result import ChainCalibration

FITS = 4.0  # rms in noise of corners up to which a turned image is a right one
_SAME = 0.05  # of the target's size, how well a point has to meet another


def turned_images(c: ChainCalibration) -> dict[int, tuple[int, ...]]:
    """Left out images of the first chain that fit with their corners counted from elsewhere, per turn in degrees.

    The turn is what the target would have to be turned by about its z, to look as it was taken for.

    Args:
        c: a calibration.
    """
    s = c.problem.sightings[0]
    images = c.wrong[0]
    orders = {turn: order for turn in (90, 180, 270) if (order := _order(s.points, turn)) is not None}
    if not len(images) or not orders:
        return {}
    at = s.evaluate(c.fit.unknowns, c.fit.errors[0]).T[images]
    points = np.einsum("nij,mj->nmi", at[:, :3, :3], s.points) + at[:, None, :3, 3]
    expected = c.problem.camera.project(points)
    noise = s.sigma(c.problem.pixel_sigma)[images]
    found: dict[int, list[int]] = {}
    for image, seen, wanted, sigma in zip(images, s.pixels[images], expected, noise, strict=True):
        for turn, order in orders.items():
            rms = float(np.sqrt(np.nanmean(((seen - wanted[order]) / sigma) ** 2)))
            if rms < FITS:
                found.setdefault(turn, []).append(int(image))
    return {turn: tuple(of) for turn, of in sorted(found.items())}


def _order(points: Array, turn: int) -> npt.NDArray[np.intp] | None:
    """Which corner stands for each if the target is turned about its middle; None if it does not meet itself."""
    middle = points.mean(axis=0)
    there = (points - middle) @ rot_z(np.radians(turn)).T + middle
    off = np.linalg.norm(there[:, None] - points, axis=-1)
    order = off.argmin(axis=1)
    size = float(np.ptp(points, axis=0).max())
    if off.min(axis=1).max() > _SAME * size or len(np.unique(order)) < len(order):
        return None
    return np.asarray(order)
