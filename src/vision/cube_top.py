"""The top of a cube, measured in photographs: where its four sides lie, to a small part of a pixel.

A camera above a board tells a cube's height by the size of its top: 4 mm higher is 0.15 mm wider, half a pixel. So
each side is fitted by itself. A top is even; going outwards, the first step of grey ends it. About that step the mean
profile across a piece of the side is a sum of steps that are blurred alike: the side's own, and those of the cube's
foot and the hole's mouth, where they are seen beside it. A line through the pieces gives the side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import erf

from arm.se3 import Array, apply, frozen, inverse, transform
from vision.camera import Camera
from vision.frames import Image
from vision.grey_steps import PlateView, plate_view

SPAN = 2.7e-3  # m, of a profile on both sides of where the side should be
STEP = 0.06e-3  # m, between its samples
ACROSS: Array = np.arange(-SPAN, SPAN + STEP / 2, STEP)
SEARCH = 1.3e-3  # m, farther off a side is not looked for
INSIDE, OUTSIDE = 0.9e-3, 0.8e-3  # m, of the window in which a side is fitted
REFINE = 0.3e-3  # m, about where it was first seen
PIECE_REFINE = 0.12e-3  # m, of a piece about the whole side
PIECES = 8  # of a side
CORNER = 4e-3  # m of a side beside its ends that is not used
PITCH = 0.2e-3  # m between samples along a piece
MOST_TURN = 0.6e-3  # m at the end of a side: 2 degrees
BLURS_PX = (0.55, 0.8, 1.1, 1.5, 2.0, 2.8)  # standard deviations that are tried
FINER = (0.88, 0.94, 1.06, 1.12)  # of the best of them
RIDGE = 1e-6  # keeps steps that are left out at nothing
APART = 0.35  # of a blur: edges nearer to each other than this count as one
SQUARE_BLUR_PX = 1.0  # of the filter that finds steps
LEAST_GROWTH, MOST_GROWTH = -0.25e-3, 0.65e-3  # m, of a top's width: 6 mm lower to 16 mm higher
USUAL_STEP = 4.0  # grey levels: a step of that counts half
LEAST_SHOWN = 2.0  # of four sides
PAIRS = ((3, 1), (0, 2))  # sides that are opposite, along x and y
FLOOR_PX = 0.03  # of a side's place: what no repetition shows
BESIDE = ((0.4e-3, 55e-6), (0.8e-3, 35e-6), (1.4e-3, 20e-6))  # m, m: the same where another edge is so near
OUTWARD = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])  # of the sides, counter-clockwise
LEAST_STD = 2e-6  # m, of a piece


@dataclass(frozen=True, eq=False)
class CubeTop:
    """A cube's top as if it lay at the height it was looked for.

    Attributes:
        widths: between opposite sides along x and y, (2,) m.
        stds: their standard deviations, (2,) m.
        centre: from where it was looked for, (2,) m.
        turn: about the place's normal, rad.
        distance: of the camera along the place's normal, m.
        slope: how far aside of the place the camera is, a metre of that, (2,).
    """

    widths: Array
    stds: Array
    centre: Array
    turn: float
    distance: float
    slope: Array


@dataclass(frozen=True)
class _Side:
    """How far a side is out, m, at its middle and per m along it."""

    offset: float
    turn: float
    std: float


def measure_top(
    images: Sequence[Image],
    camera: Camera,
    T_base_place: Array,
    size: float,
    height: float,
    mouth: float | None,
) -> CubeTop | None:
    """Measure the top of a cube; None where it is not whole in the image.

    Args:
        images: photographs of one moment.
        camera: that took them.
        T_base_place: of the place's frame, z along its normal, 4x4.
        size: edge of the cube, m.
        height: of its top over the place's plane, m.
        mouth: width of the hole it stands in, m; None: it stands on the plane.
    """
    T_base_top = T_base_place @ transform(t=(0.0, 0.0, height))
    view = plate_view(images, camera, T_base_top, 0.75 * size + SPAN)
    eye = apply(inverse(T_base_top), camera.T_base_camera[:3, 3])
    if view is None or eye[2] <= size:
        return None
    profiles = [_profiles(view, size, k) for k in range(4)]
    if not all(np.isfinite(p).all() for p in profiles):
        return None
    scale = view.px_per_m()
    beside = [_edges_beside(float(eye @ (*out, 0.0)), eye[2], size, height, mouth) for out in OUTWARD]
    square = _square(profiles, SQUARE_BLUR_PX / scale, size)
    if square is None:
        return None
    out, turn = square
    blur_px, best, fits = 1.0, np.inf, []
    for tried in (BLURS_PX, FINER):
        for one in blur_px * np.array(tried):
            now = [
                _fit(p, b, (o, turn), one / scale, size)
                for p, b, o in zip(profiles, beside, out, strict=True)
            ]
            left = sum(rest for _, rest in now)
            if left < best:
                best_px, best, fits = float(one), left, now
        blur_px = best_px
    sides = [side for side, _ in fits]
    return _top(sides, beside, size, FLOOR_PX / scale, eye)


def _top(
    sides: Sequence[_Side],
    beside: Sequence[Sequence[tuple[float, bool]]],
    size: float,
    floor: float,
    eye: Array,
) -> CubeTop:
    widths, stds, centre = (np.full(2, np.nan) for _ in range(3))
    for axis, (low, high) in enumerate(PAIRS):
        a, b = sides[low], sides[high]
        widths[axis] = size + a.offset + b.offset
        centre[axis] = (b.offset - a.offset) / 2.0
        stds[axis] = np.sqrt(
            sum(s.std**2 + floor**2 + _crowded(beside[k]) ** 2 for k, s in ((low, a), (high, b)))
        )
    turn = -float(np.median([side.turn for side in sides]))
    return CubeTop(
        frozen(widths), frozen(stds), frozen(centre), turn, float(eye[2]), frozen(eye[:2] / eye[2])
    )


def _crowded(beside: Sequence[tuple[float, bool]]) -> float:
    """Standard deviation of a side's place, m, for another edge beside it."""
    nearest = beside[0][0] if beside else np.inf
    return next((std for near, std in BESIDE if nearest < near), 0.0)


def _edges_beside(
    eye: float, distance: float, size: float, height: float, mouth: float | None
) -> list[tuple[float, bool]]:
    """Edges seen beyond a side of the top: how far, m, and whether they move with the cube.

    Args:
        eye: how far out from the top's centre the camera is, m.
        distance: of the camera from the top's plane, m.
    """
    half = size / 2.0
    foot = eye + (half - eye) * distance / (distance + size) - half
    found = [(foot, True)] if foot > 0.0 else []
    if mouth is not None:
        rim = eye + (mouth / 2.0 - eye) * distance / (distance + height) - half
        if rim > 0.0:
            found = [*(edge for edge in found if edge[0] < rim), (rim, False)]
    return found


def _profiles(view: PlateView, size: float, k: int) -> Array:
    """Mean profiles of grey outwards across the pieces of side k, (PIECES, n)."""
    outward = OUTWARD[k]
    tangent = np.array([-outward[1], outward[0]])
    ends = np.linspace(-size / 2.0 + CORNER, size / 2.0 - CORNER, PIECES + 1)
    count = max(round((ends[1] - ends[0]) / PITCH), 1)
    along = ends[:-1, None] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    points = (size / 2.0 + ACROSS)[None, :, None, None] * outward + along[:, None, :, None] * tangent
    return np.asarray(view.at(points).mean(axis=2))


def _square(profiles: Sequence[Array], blur: float, size: float) -> tuple[Array, float] | None:
    """Where the sides of one square are, (4,) m out, and its turn, m at a side's end; None if no square shows.

    Any step of grey counts about alike, however high: what stands behind a cube may differ more from its foot than
    its top from what is beside it. Only steps that together make a square of about the cube's size are its sides.
    """
    reach = round(2.0 * blur / STEP)
    at = np.arange(-reach, reach + 1)
    kernel = -np.exp(-0.5 * (at * STEP / blur) ** 2) * at
    kernel /= np.abs(kernel).sum() / 2.0  # gives a wide step's height
    index, lever = np.arange(len(ACROSS)), _middles(size) / _middles(size)[-1]
    slopes = np.array([[np.convolve(piece, kernel, mode="same") for piece in p] for p in profiles])
    slopes[:, :, : reach + 1] = slopes[:, :, -reach - 1 :] = 0.0
    shifts = np.arange(-round(SEARCH / STEP), round(SEARCH / STEP) + 1)
    grows = np.arange(round(LEAST_GROWTH / STEP), round(MOST_GROWTH / STEP) + 1)  # of both sides together
    middle = len(ACROSS) // 2
    best: tuple[float, Array, float] | None = None
    for turn in np.linspace(-MOST_TURN, MOST_TURN, 25):
        moved = np.rint(turn * lever / STEP).astype(int)
        places = np.clip(index + moved[:, None], 0, len(index) - 1)
        steps = np.take_along_axis(slopes, places[None], axis=2).mean(axis=1) ** 2
        shows = steps / (steps + USUAL_STEP**2)
        for grow in grows:
            half = grow // 2
            pairs = [
                shows[low, middle - shifts + half] + shows[high, middle + shifts + grow - half]
                for low, high in PAIRS
            ]
            found = [int(np.argmax(pair)) for pair in pairs]
            worth = sum(float(pair[i]) for pair, i in zip(pairs, found, strict=True))
            if best is None or worth > best[0]:
                out = np.empty(4)
                for (low, high), i in zip(PAIRS, found, strict=True):
                    out[low], out[high] = half - shifts[i], grow - half + shifts[i]
                best = worth, out * STEP, float(turn)
    return None if best is None or best[0] < LEAST_SHOWN else best[1:]


def _middles(size: float) -> Array:
    """Of a side's pieces, m along it."""
    return np.asarray(np.linspace(-0.5, 0.5, 2 * PIECES + 1)[1::2] * (size - 2.0 * CORNER))


def _fit(
    profiles: Array,
    beside: Sequence[tuple[float, bool]],
    first: tuple[float, float],
    blur: float,
    size: float,
) -> tuple[_Side, float]:
    """A side near `first`, m out and m of turn at its end; and what the fit leaves of its pieces, grey levels^2."""
    middles = _middles(size)
    lever = middles / middles[-1]
    starts = np.rint((first[0] + first[1] * lever + SPAN) / STEP).astype(int)
    window = np.arange(-round(INSIDE / STEP), round(OUTSIDE / STEP) + 1)
    places = np.clip(starts[:, None] + window, 0, len(ACROSS) - 1)
    cut = np.take_along_axis(profiles, places, axis=1)
    shifts = np.asarray(np.arange(-REFINE, REFINE + STEP / 4, STEP / 2), dtype=float)
    rests = _rests(cut, np.asarray(window * STEP), shifts, beside, np.asarray(ACROSS[starts]), blur)
    whole = int(np.argmin(rests[1:-1].sum(axis=1))) + 1
    reach = round(2.0 * PIECE_REFINE / STEP)
    low, high = max(whole - reach, 1), min(whole + reach + 1, len(shifts) - 1)
    offsets = np.empty(len(cut))
    for piece in range(len(cut)):
        j = low + int(np.argmin(rests[low:high, piece]))
        before, here, after = rests[j - 1 : j + 2, piece]
        bend = before - 2.0 * here + after
        to_least = 0.25 * STEP * (before - after) / bend if bend > 0.0 else 0.0
        offsets[piece] = ACROSS[starts[piece]] + shifts[j] + to_least
    return _line(middles, offsets), float(rests[whole].sum())


def _rests(
    cut: Array,
    across: Array,
    shifts: Array,
    beside: Sequence[tuple[float, bool]],
    starts: Array,
    blur: float,
) -> Array:
    """What is left of each piece, grey levels^2, with the side at each of `shifts` from its start, (shifts, pieces)."""

    def step(edge: Array) -> Array:
        return np.asarray(erf((across - edge[..., None]) / (np.sqrt(2.0) * blur)))

    last = np.repeat(shifts[:, None], len(cut), axis=1)
    even = np.ones((*last.shape, len(across)))
    columns = [even, even * across / SPAN, step(last)]
    for place, moves in beside:
        edge = shifts[:, None] + place if moves else np.repeat((place - starts)[None], len(shifts), axis=0)
        if not moves:  # before the mouth's edge the hole's wall is seen, darker with depth
            within = (across > last[..., None]) & (across < edge[..., None])
            wall = np.where(within, across - last[..., None], 0.0) / SPAN
            columns.append(wall * (edge - last > 2.0 * blur)[..., None])
        apart = (edge > last + APART * blur) & (edge < OUTSIDE + blur)
        columns.append(step(edge) * apart[..., None])
        last = np.where(apart, edge, last)
    A = np.stack(columns, axis=-1)
    square = np.swapaxes(A, -1, -2) @ A + RIDGE * np.eye(A.shape[-1])
    b = np.swapaxes(A, -1, -2) @ cut[None, :, :, None]
    left = cut[None] - (A @ np.linalg.solve(square, b))[..., 0]
    return np.asarray((left**2).sum(axis=-1))


def _line(along: Array, offsets: Array) -> _Side:
    """A line through the pieces; those far off count less (Huber's weights)."""
    A = np.stack([np.ones_like(along), along], axis=-1)
    weights = np.ones(len(offsets))
    for _ in range(5):
        line = np.linalg.solve((A * weights[:, None]).T @ A, (A * weights[:, None]).T @ offsets)
        off = np.abs(offsets - A @ line)
        usual = max(1.4826 * float(np.median(off)), LEAST_STD)
        weights = 1.0 / np.maximum(1.0, off / (2.0 * usual))
    spread = np.sqrt((weights * off**2).sum() / max(weights.sum() - 2.0, 1.0))
    covariance = np.linalg.inv((A * weights[:, None]).T @ A) * max(float(spread), LEAST_STD) ** 2
    return _Side(float(line[0]), float(line[1]), float(np.sqrt(covariance[0, 0])))
