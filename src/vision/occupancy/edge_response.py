"""Find the stations of a border at which images show it: those with a step of grey across it.

A step is the difference between the mean greys of two small windows on both sides of the border. It counts if it
exceeds the noise, which is estimated from the images, and the steps of smooth surfaces and soft shadows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.se3 import Array, Indices, apply
from vision.camera.frame_source import Image
from vision.camera.model import Camera

GAP = 0.3e-3  # m between a border and its windows: the blur of the lens
WINDOW = 0.8e-3  # m, width of a window
STEP = 0.2e-3  # m between samples across a border
ALONG = (-0.6e-3, -0.2e-3, 0.2e-3, 0.6e-3)  # m, samples along it
NOISE_FACTOR = 3.0  # smallest step, in standard deviations
ROUGH_FACTOR = 6.5  # the same in a patch, where windows are smaller and every step counts
SMOOTH_STEP = 0.03  # smallest step, relative to a marker's contrast
LEAST_NOISE = 0.3  # grey levels, from rounding to integers
_LAPLACE = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])  # J. Immerkaer, 1996: gain 6


@dataclass(frozen=True, eq=False)
class PlateView:
    """The mean of images, sampled at points of a board's top plane.

    Attributes:
        grey: mean image around the place of interest, (h, w).
        corner_px: position of its first pixel in the images, (2,) px.
        camera: camera of the images.
        T_base_plane: pose of the plane's frame, 4x4.
    """

    grey: npt.NDArray[np.float32]
    corner_px: Array
    camera: Camera
    T_base_plane: Array

    def at(self, points: Array) -> Array:
        """Return the grey levels at points (..., 2) m of the plane; NaN outside the view."""
        points3 = np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)
        pixels = self.camera.project_base(apply(self.T_base_plane, points3.reshape(-1, 3))) - self.corner_px
        height, width = self.grey.shape
        beyond = np.maximum(-pixels, pixels - (width - 1.0, height - 1.0)).max(axis=-1)
        inside = np.asarray(beyond <= 0.0)  # NaN counts as outside
        x, y = np.where(inside[:, None], pixels, 0.0).astype(np.float32).T
        values = cv2.remap(self.grey, x[None], y[None], cv2.INTER_LINEAR)[0].astype(float)
        return np.where(inside, values, np.nan).reshape(points.shape[:-1])

    def noise(self) -> float:
        """Standard deviation of the mean image's noise, grey levels."""
        rough = cv2.filter2D(self.grey, cv2.CV_32F, _LAPLACE)[1:-1, 1:-1]
        return max(1.4826 * float(np.median(np.abs(rough))) / 6.0, LEAST_NOISE)

    def px_per_m(self) -> float:
        """Scale of the image at the plane's origin, px/m."""
        ends = apply(self.T_base_plane, [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]])
        return float(np.linalg.norm(np.diff(self.camera.project_base(ends), axis=0))) * 1e3


def plate_view(
    images: Sequence[Image], camera: Camera, T_base_plane: Array, reach: float
) -> PlateView | None:
    """Return the view of a plane within `reach` m of its origin; None if it is outside the image."""
    angle = np.linspace(0.0, 2.0 * np.pi, 33)
    circle = reach * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    pixels = camera.project_base(apply(T_base_plane, circle))
    if not np.isfinite(pixels).all():
        return None
    low = np.maximum(np.floor(pixels.min(axis=0)), 0.0).astype(int)
    high = np.minimum(np.ceil(pixels.max(axis=0)) + 1.0, camera.size).astype(int)
    if (high - low < 8).any():
        return None
    part = np.s_[low[1] : high[1], low[0] : high[0]]
    total = np.zeros((high[1] - low[1], high[0] - low[0]), dtype=np.float32)
    for image in images:
        cut = image[part].astype(np.float32)
        total += cut if cut.ndim == 2 else cut.mean(axis=-1)
    return PlateView((total / len(images)).astype(np.float32), low.astype(float), camera, T_base_plane)


@dataclass(frozen=True)
class StepLimits:
    """Criteria for a step of grey to be a border.

    Attributes:
        noise: standard deviation of a step, grey levels.
        smooth: upper limit of steps on smooth surfaces, grey levels.
        tolerance: largest distance of a border from its predicted place, m.
    """

    noise: float
    smooth: float
    tolerance: float

    @property
    def least(self) -> float:
        """Smallest step that counts, grey levels."""
        return max(NOISE_FACTOR * self.noise, self.smooth)


def step_limits(view: PlateView, contrast: float, tolerance: float) -> StepLimits:
    """Return the limits for a view.

    Args:
        view: its noise and scale count.
        contrast: grey levels between a marker's black and white.
        tolerance: see `StepLimits`.
    """
    window_px = WINDOW * (ALONG[-1] - ALONG[0] + WINDOW / 4.0) * view.px_per_m() ** 2
    return StepLimits(view.noise() * np.sqrt(2.0 / max(window_px, 1.0)), SMOOTH_STEP * contrast, tolerance)


def seen_stations(view: PlateView, points: Array, outward: Array, limits: StepLimits, ring: bool) -> Array:
    """Return whether each station of a border has a step of grey, (n,): 1, 0, or NaN outside the image.

    The whole border may be shifted by up to the tolerance, and a straight one may also be rotated within it. The place
    with the most visible stations counts. A straight border may step up in one part and down in another if a shadow
    lies across it; a ring steps up or down as a whole.

    Args:
        view: view of the plane of the points.
        points: stations, (n, 2) m.
        outward: normals, (n, 2).
        limits: limits of a step.
        ring: whether the border is a closed ring.
    """
    if not len(points):
        return np.zeros(0)
    most = round(limits.tolerance / STEP)
    steps = _steps(view, points, outward, most)
    found = steps[np.arange(len(points)), _places(outward, most, ring)]  # (places, n)
    up, down = found > limits.least, found < -limits.least
    shows = np.concatenate([up, down]) if ring else up | down
    best = shows[int(np.argmax(shows.sum(axis=1)))]
    # shifted places outside the image count as 0; the predicted place must be inside
    return np.where(np.isnan(steps[:, most]), np.nan, best.astype(float))


def mean_step(view: PlateView, points: Array, outward: Array) -> float:
    """Return the mean outward step of grey of a border at its predicted place; NaN if part of it is outside."""
    return float(_steps(view, points, outward, 0).mean())


def rough_part(view: PlateView, points: Array, limits: StepLimits) -> float:
    """Return the fraction of a patch, points (n, m, 2) m at a pitch of `WINDOW`, with a step of grey along x or y."""
    quarter = WINDOW / 4.0
    corners = np.array([[x, y] for x in (-quarter, quarter) for y in (-quarter, quarter)])
    grey = view.at(points[:, :, None] + corners).mean(axis=-1)
    least = max(ROUGH_FACTOR * limits.noise, limits.smooth)
    with np.errstate(invalid="ignore"):
        along = np.abs(grey[2:, 1:-1] - grey[:-2, 1:-1]) > least
        across = np.abs(grey[1:-1, 2:] - grey[1:-1, :-2]) > least
    return float((along | across).mean())


def _steps(view: PlateView, points: Array, outward: Array, most: int) -> Array:
    """Outward steps of grey at stations shifted by -`most` to `most` times `STEP`, (n, 2 most + 1)."""
    span = round((GAP + WINDOW) / STEP)
    offsets = STEP * np.arange(-most - span, most + span + 1)
    tangent = np.stack([-outward[:, 1], outward[:, 0]], axis=-1)
    places = (
        points[:, None, None]
        + offsets[:, None, None] * outward[:, None, None]
        + np.array(ALONG)[:, None] * tangent[:, None, None]
    )
    profile = view.at(places).mean(axis=-1)  # (n, offsets)
    across = np.arange(-span, span + 1)
    sides = np.sign(across) * (np.abs(across) * STEP > GAP - STEP / 2)
    windows = np.lib.stride_tricks.sliding_window_view(profile, 2 * span + 1, axis=1)
    return np.asarray(windows @ (sides / (sides > 0).sum()))


def _places(outward: Array, most: int, ring: bool) -> Indices:
    """Possible places of a border: the index of the shift at each station, (places, n)."""
    shifts = range(-most, most + 1)
    if ring:
        moved = [(x, y) for x in shifts for y in shifts if x * x + y * y <= most * most]
        fields = [x * outward[:, 0] + y * outward[:, 1] for x, y in moved]
    else:
        along = np.linspace(-1.0, 1.0, len(outward))
        fields = [s + turn * along for s in shifts for turn in shifts if abs(s) + abs(turn) <= most]
    return np.asarray(np.rint(np.array(fields)).astype(np.intp) + most)
