"""Measure the four sides of a cube's top in the image, near where a pose predicts them, to a fraction of a pixel.

Each side is sampled by profiles across it (C. Harris and C. Stennett, "RAPID - a video rate object tracker", 1990). A
top has one grey level. So the first step of grey outwards is its side, whatever lies beyond: a face of the cube, the
plate, or the print of a marker. A straight line is fitted to the steps of a side. Its uncertainty includes what all
steps share: a narrow face or a near mouth beside the top shifts the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from arm.se3 import Array, Indices, apply, frozen
from vision.loose.steps import OFFSETS, first_steps
from vision.occupancy.edge_response import PlateView

CORNER = 3e-3  # m at each end of a side that is not used
STATIONS = 24  # per side
ALONG = (-0.45e-3, 0.0, 0.45e-3)  # m along the side, samples of a station
STEP_PX = 0.25  # between samples across a side
SMOOTH_PX = 1.0  # standard deviation of the derivative's kernel
RELATIVE = 0.3  # smallest step that counts, as a fraction of the side's usual one
NOISE_FACTOR = 6.0  # the same, in standard deviations of a response
LEAST_SLOPE = 1.5  # the same, grey levels per px
INLIER_PX = 0.7  # largest distance of a step from its side's line
FLOOR_PX = 0.02  # standard deviation that all steps of a side share: lens, rounding, the cube's own shape
# a narrow face and a near mouth, which the lens does not resolve, shift a side: the distance of their edge at which
# the shift is largest, the standard deviation of that distance, and that of the shift, px
FACE_EDGE = (1.8, 2.0, 0.18)
MOUTH_EDGE = (1.2, 1.2, 0.12)
PARALLEL = np.cos(np.radians(8.0))  # of a mouth's edge to a side
TOWARDS_PX = 2.0  # beyond the search, for the derivative's kernel
ROUGH_PX = 0.15  # standard deviation of a side that is not measured exactly
LEAST_SCATTER_PX = 0.05  # of steps about their line
LEAST_STATIONS = 6  # of a side, to fit its line
OUTWARD = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])  # normals, counter-clockwise
TANGENT = np.stack([-OUTWARD[:, 1], OUTWARD[:, 0]], axis=-1)


@dataclass(frozen=True, eq=False)
class Sides:
    """The measured sides of a top: two points of each line, whose errors are independent.

    Attributes:
        side: number of the side of each point, (n,).
        along: place of each point on its side, m from the middle, (n,).
        points: (n, 2) px.
        std: standard deviation across the side, (n,) px.
        shown: fraction of each side's stations with a step on its line, (4,).
        rms: root mean square distance of these steps from their lines, px; NaN without any.
    """

    side: Indices
    along: Array
    points: Array
    std: Array
    shown: Array
    rms: float


def top_points(size: float, side: Indices, along: Array) -> Array:
    """Points (n, 3) m of a cube's frame on the sides (n,) of its top, `along` (n,) m from their middles."""
    half = size / 2.0
    flat = half * OUTWARD[side] + along[:, None] * TANGENT[side]
    return np.concatenate([flat, np.full((len(side), 1), half)], axis=1)


def side_normals(
    view: PlateView, T_base_cube: Array, size: float, side: Indices, along: Array
) -> tuple[Array, Array]:
    """Pixels (n, 2) of points of the top's sides, and unit normals there, outwards in the image, (n, 2)."""
    middle = top_points(size, side, along)
    ahead = middle + 1e-3 * np.concatenate([TANGENT[side], np.zeros((len(side), 1))], axis=1)
    outer = middle + 1e-3 * np.concatenate([OUTWARD[side], np.zeros((len(side), 1))], axis=1)
    pixels = view.camera.project_base(apply(T_base_cube, np.stack([middle, ahead, outer])))
    tangent = pixels[1] - pixels[0]
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.sign(np.sum(normal * (pixels[2] - pixels[0]), axis=1, keepdims=True))
    return pixels[0], normal


def measure_sides(
    view: PlateView,
    T_base_cube: Array,
    size: float,
    reach_px: float,
    noise: float,
    exact: bool = False,
    mouth_px: Array | None = None,
) -> Sides:
    """Measure the sides of a top near where a pose predicts them.

    Args:
        view: the image around the top.
        T_base_cube: predicted pose.
        size: edge of the cube, m.
        reach_px: greatest distance of a side from where it is predicted.
        noise: standard deviation of the view's noise, grey levels.
        exact: whether to take into account that a second step near a side may shift it.
        mouth_px: corners of a pocket's mouth, (4, 2) px.
    """
    ends = size / 2.0 - CORNER
    stations = np.linspace(-ends, ends, STATIONS)
    side = np.repeat(np.arange(4), STATIONS)
    along = np.tile(stations, 4)
    spread = (along[:, None] + np.array(ALONG)).ravel()
    pixels, normal = side_normals(view, T_base_cube, size, np.repeat(side, len(ALONG)), spread)
    beyond = np.arange(-reach_px - TOWARDS_PX, reach_px + TOWARDS_PX + STEP_PX / 2.0, STEP_PX)
    grey = _sampled(view, pixels[:, None] + beyond[:, None] * normal[:, None])
    profile = grey.reshape(len(side), len(ALONG), -1).mean(axis=1)
    sigma = SMOOTH_PX / STEP_PX
    slope = gaussian_filter1d(profile, sigma, axis=1, order=1, mode="nearest") / STEP_PX  # NaN spreads
    noise = noise / (2.0 * np.sqrt(len(ALONG))) / SMOOTH_PX
    found = _first_steps(slope, beyond, reach_px, noise)
    shown, squares, halves = np.zeros(4), [], []
    for k in range(4):
        here = np.isfinite(found[side == k])
        offset, at = found[side == k][here], stations[here]
        line = _line(at, offset)
        if line is None:
            continue
        (a, b), on = line
        shown[k] = on.sum() / STATIONS
        rest = offset - a - b * at
        squares.append(rest[on] ** 2)
        for half in (on & (at < 0.0), on & (at > 0.0)):
            if half.sum() >= LEAST_STATIONS // 2:
                halves.append(_Half(k, at[half], a + b * at[half], float(np.sqrt((rest[half] ** 2).mean()))))
    unresolved = _unresolved(view, T_base_cube, size, mouth_px)
    kept = _exact(view, T_base_cube, size, halves, unresolved) if exact else _rough(halves)
    number = np.array([k for k, *_ in kept], dtype=np.intp)
    x, offset, std = (np.array([of[i] for of in kept]) for i in (1, 2, 3))
    base, normal = side_normals(view, T_base_cube, size, number, x)
    rms = float(np.sqrt(np.concatenate(squares).mean())) if squares else np.nan
    return Sides(number, frozen(x), frozen(base + offset[:, None] * normal), frozen(std), frozen(shown), rms)


def _sampled(view: PlateView, pixels: Array) -> Array:
    """Grey levels at pixels (..., 2) of the whole image; NaN outside the view."""
    at = pixels - view.corner_px
    height, width = view.grey.shape
    inside = (
        (at[..., 0] >= 0.0) & (at[..., 1] >= 0.0) & (at[..., 0] <= width - 1) & (at[..., 1] <= height - 1)
    )
    x, y = np.where(inside, at[..., 0], 0.0), np.where(inside, at[..., 1], 0.0)
    values = cv2.remap(view.grey, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    return np.where(inside, values.astype(float), np.nan)


def _first_steps(slope: Array, beyond: Array, reach: float, noise: float) -> Array:
    """Place of the first step outwards of each profile, px, (n,); NaN without one."""
    size = np.where(np.isfinite(slope), np.abs(slope), 0.0)
    inside = np.abs(beyond) <= reach
    highest = size[:, inside].max(axis=1)
    usual = np.repeat(np.median(highest.reshape(4, -1), axis=1), len(size) // 4)
    least = np.maximum(np.maximum(NOISE_FACTOR * noise, LEAST_SLOPE), RELATIVE * usual)
    peak = np.zeros(size.shape, dtype=bool)
    peak[:, 1:-1] = (size[:, 1:-1] >= size[:, :-2]) & (size[:, 1:-1] > size[:, 2:])
    peak &= size >= least[:, None]
    first = np.argmax(peak & inside, axis=1)
    rows = np.arange(len(size))
    good = (peak & inside)[rows, first]
    first = np.clip(first, 1, len(beyond) - 2)
    low, mid, high = (size[rows, first + i] for i in (-1, 0, 1))
    bend = np.where(good, low - 2.0 * mid + high, -1.0)
    found = beyond[first] + STEP_PX * np.where(
        good, 0.5 * (low - high) / np.where(bend < 0.0, bend, -1.0), 0.0
    )
    return np.where(good, found, np.nan)


@dataclass(frozen=True, eq=False)
class _Half:
    """Steps on the line of one half of a side: their places along it, m, and across, px; their scatter, px."""

    side: int
    along: Array
    across: Array
    scatter: float


def _unresolved(view: PlateView, T_base_cube: Array, size: float, mouth_px: Array | None) -> Array:
    """Standard deviation of each side's shift by a narrow face or a mouth's edge beside it, px, (4,)."""
    side, middle = np.arange(4), np.zeros(4)
    upper, normal = side_normals(view, T_base_cube, size, side, middle)
    lower = view.camera.project_base(apply(T_base_cube, top_points(size, side, middle) - (0.0, 0.0, size)))
    squares = _bump(np.sum((lower - upper) * normal, axis=1), *FACE_EDGE) ** 2
    if mouth_px is not None:
        along = np.roll(mouth_px, -1, axis=0) - mouth_px
        across = np.stack([along[:, 1], -along[:, 0]], axis=-1) / np.linalg.norm(along, axis=1)[:, None]
        cosine = normal @ across.T
        away = np.sum((mouth_px - upper[:, None]) * across, axis=-1) * np.sign(cosine)
        squares = squares + (np.where(np.abs(cosine) > PARALLEL, _bump(away, *MOUTH_EDGE), 0.0) ** 2).max(
            axis=1
        )
    return np.sqrt(squares)


def _bump(distance: Array, most: float, width: float, std: float) -> Array:
    return np.asarray(std * np.exp(-0.5 * ((distance - most) / width) ** 2))


def _rough(halves: list[_Half]) -> list[tuple[int, float, float, float]]:
    """As `_exact`, by the lines alone."""
    return [(half.side, float(half.along.mean()), float(half.across.mean()), ROUGH_PX) for half in halves]


def _exact(
    view: PlateView, T_base_cube: Array, size: float, halves: list[_Half], unresolved: Array
) -> list[tuple[int, float, float, float]]:
    """Locate the mean step of each half: its side, m along it, px across, and the standard deviation of the latter."""
    profiles = []
    for half in halves:
        along = (half.along[:, None] + np.array(ALONG)).ravel()
        pixels, normal = side_normals(view, T_base_cube, size, np.full(len(along), half.side), along)
        beyond = np.repeat(half.across, len(ALONG))[:, None] + OFFSETS
        grey = _sampled(view, pixels[:, None] + beyond[..., None] * normal[:, None])
        profiles.append(np.where(np.isfinite(grey), grey, grey[:, :1]).mean(axis=0))
    if not profiles:
        return []
    axes = np.array([half.side % 2 for half in halves], dtype=np.intp)
    kept = []
    for half, shift, std in zip(halves, *first_steps(np.array(profiles), axes), strict=True):
        own = max(half.scatter, LEAST_SCATTER_PX) / np.sqrt(len(half.along))
        # the floor and what is not resolved is shared by both halves
        std = float(np.sqrt(own**2 + std**2 + 2.0 * (FLOOR_PX**2 + unresolved[half.side] ** 2)))
        kept.append((half.side, float(half.along.mean()), float(half.across.mean() + shift), std))
    return kept


def _line(x: Array, y: Array) -> tuple[tuple[float, float], Array] | None:
    """Fit y = a + b x to most points; return (a, b) and which points are on it; None if there are too few."""
    if len(x) < LEAST_STATIONS:
        return None
    first, second = np.triu_indices(len(x), 5)
    slopes = (y[second] - y[first]) / (x[second] - x[first])
    at = y[first] - slopes * x[first]
    away = np.abs(y - at[:, None] - slopes[:, None] * x)
    best = int(np.argmin(np.minimum(away, INLIER_PX).sum(axis=1)))
    on = away[best] < INLIER_PX
    for _ in range(2):
        if on.sum() < LEAST_STATIONS or np.ptp(x[on]) < 0.25 * np.ptp(x):
            return None
        b, a = np.polyfit(x[on], y[on], 1)
        on = np.abs(y - a - b * x) < INLIER_PX
    if on.sum() < LEAST_STATIONS:
        return None
    return (float(a), float(b)), on
