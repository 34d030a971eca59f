"""Measure the top of a cube in images: likelihood of the place of each side, to a few hundredths of a pixel.

A camera above a board measures a cube's height by the width of its top and by the offset of the top from the point
below the camera: a cube that is 4 mm higher looks 0.15 mm wider, half a pixel. `vision.occupancy.cube_fit` computes the
likelihoods from the profiles across the sides and from what the image shows beside them. An invisible side (a dark cube
on a dark wall, a cube as grey as the plate) has a flat likelihood, so the others decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from arm.board import POCKET_DEPTH
from arm.se3 import Array, apply, frozen, inverse, transform
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.occupancy.cube_fit import PIECES, PLACES, Around, fit_sides, likelihoods, straight_lines
from vision.occupancy.cube_side import ACROSS, SPAN, Side, whitening
from vision.occupancy.edge_response import PlateView, plate_view
from vision.occupancy.expected_edges import seen_on_plate

CORNER = 4e-3  # m at each end of a side that is not used
PITCH = 0.2e-3  # m between samples along a piece
BLURS_PX = (0.7, 0.85, 1.0, 1.25, 1.6)  # standard deviations to try, including a sample's own blur
FLOOR_PX = 0.04  # standard deviation of a side's place that is the same in all images
WIDE_FACE = 1.0e-3  # m: with a wider face, the profile is ignored near its foot and beyond,
BEFORE_FOOT, SOFT = 0.4e-3, 0.05e-3  # m: from this distance before the foot, with this softness
# visible fraction of a narrow face (its lowest part is dark); standard deviation
FOOT_SEEN, FOOT_SHARE = 0.9, 0.07
FOOT_DARK, FOOT_STD = 1e-3, 25e-6  # m: width of a narrow face; standard deviation that is added
RING = np.array([2e-3, 3e-3, 4e-3, 5e-3])  # m beyond a mouth, where the plate's grey is measured
LEAST_IN_VIEW = 0.6e-3  # m beyond a side that must be in the image
MEAN_NOISE = 0.85  # fraction of a sample's noise that remains after interpolation
LEAST_NOISE = 0.3  # grey levels
LIGHT = (0.6, 1.3)  # limits of the change of brightness between two looks
OUTWARD = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])  # normals, counter-clockwise


@dataclass(frozen=True, eq=False)
class EmptyPlace:
    """Images of a place without a cube: they show what will be beside the cube.

    Attributes:
        images, camera: the images, and the camera that took them.
        T_base_place: pose of the place at that time, 4x4.
    """

    images: Sequence[Image]
    camera: Camera
    T_base_place: Array


@dataclass(frozen=True, eq=False)
class CubeTop:
    """A cube's top, measured as if it lay at the assumed height.

    Attributes:
        sides: log likelihood of each side at `PLACES` (m outwards), (4, k); flat if it does not show.
        shown: log likelihood ratio of each side to no side, (4,); 0 where the step may be shading.
        turn: rotation about the place's normal, rad.
        twist: log likelihood ratio of sides with a rotation each to sides with a common rotation.
        distance: distance of the camera from the top along the normal, m.
        slope: offset of the camera across the normal, divided by `distance`, (2,).
        size: assumed width, m.
        rise: rise of the top per metre of additional width of the cube.
    """

    sides: Array
    shown: Array
    turn: float
    twist: float
    distance: float
    slope: Array
    size: float
    rise: float


def measure_top(
    images: Sequence[Image],
    camera: Camera,
    T_base_place: Array,
    size: float,
    height: float,
    mouth: float | None,
    rise: float = 1.0,
    empty: EmptyPlace | None = None,
) -> CubeTop | None:
    """Measure the top of a cube; None if it is not completely in the image.

    Args:
        images: taken at one moment.
        camera: camera that took them.
        T_base_place: pose of the place, z along its normal, 4x4.
        size: edge of the cube, m.
        height: assumed height of its top above the place's plane, m.
        mouth: width of the hole's mouth, m; None if the cube stands on the plane.
        rise: rise of the top per metre of additional width of the cube.
        empty: the same place while it was empty.
    """
    view = plate_view(images, camera, T_base_place @ transform(t=(0.0, 0.0, height)), 0.75 * size + SPAN)
    reach = 1.2 * size + SPAN
    plane = plate_view(images, camera, T_base_place, reach)
    eye = apply(inverse(T_base_place), camera.T_base_camera[:3, 3])
    if view is None or plane is None or eye[2] <= height + size:
        return None
    before = None if empty is None else plate_view(empty.images, empty.camera, empty.T_base_place, reach)
    distance = float(eye[2]) - height
    scale = view.px_per_m()
    ring = _ring(size if mouth is None else mouth, eye)
    plate_grey = _level(plane, ring)
    grey_before = np.nan if before is None else _level(before, ring)
    light = float(np.clip(plate_grey / grey_before, *LIGHT)) if grey_before > 0.0 else np.nan
    noise = MEAN_NOISE * max(view.noise(), LEAST_NOISE) / np.sqrt((size - 2.0 * CORNER) / PIECES * scale)
    if not np.isfinite(plate_grey):
        return None

    sides, around = [], []
    for k in range(4):
        points = _points(size, k)
        grey = view.at(points).mean(axis=2)
        out = float(eye[:2] @ OUTWARD[k])
        rim = corner = -np.inf
        if mouth is not None:
            # walls are straight through the seat
            floor = mouth - POCKET_DEPTH * (mouth - size) / (size - height)
            rim = out + (mouth / 2.0 - out) * distance / float(eye[2]) - size / 2.0
            corner = out + (floor / 2.0 - out) * distance / (float(eye[2]) + POCKET_DEPTH) - size / 2.0
        without = None if before is None else before.at(seen_on_plate(points, height, eye)).mean(axis=2)
        if without is not None and not (np.isfinite(without).all() and np.isfinite(light)):
            without = None
        side = _side(grey, _feet(eye, k, 0.0, size, distance), plate_grey, noise, scale)
        if side is None:
            return None
        sides.append(side)
        around.append(Around(without, rim, corner))
    lever = -np.linspace(-0.5, 0.5, 2 * PIECES + 1)[1::2] * (size - 2.0 * CORNER)
    blurs = [px / scale for px in BLURS_PX]
    first = fit_sides(sides, around, light, lever, blurs[2:3]).lines.turn
    sides = [replace(side, feet=_feet(eye, k, first, size, distance)) for k, side in enumerate(sides)]
    fit = fit_sides(sides, around, light, lever, blurs)
    turn, of_sides, shown = likelihoods(sides, fit, lever)
    return CubeTop(
        frozen([_softened(one, FLOOR_PX / scale) for one in of_sides]),
        frozen(shown),
        turn,
        sum(straight_lines([one], lever).worth for one in fit.each) - fit.lines.worth,
        distance,
        frozen(eye[:2] / distance),
        size,
        rise,
    )


def _softened(log: Array, floor: float) -> Array:
    """Convolve a likelihood at `PLACES` with a Gaussian of standard deviation `floor` m; both as logarithms."""
    sigma = floor / float(PLACES[1] - PLACES[0])
    soft = np.log(gaussian_filter1d(np.exp(log), sigma, mode="nearest", radius=4) + 1e-30)
    return np.asarray(soft - soft.max())


def _feet(eye: Array, k: int, turn: float, size: float, distance: float) -> Array:
    """Distances beyond side k of a rotated cube at which its foot may be seen, m, (n,); 0 if hidden."""
    outward = OUTWARD[k] + turn * np.array([-OUTWARD[k][1], OUTWARD[k][0]])
    foot = (float(eye[:2] @ outward) - size / 2.0) * size / (distance + size)
    dark = min(max(foot, 0.0), FOOT_DARK)
    usual, deviation = foot - (1.0 - FOOT_SEEN) * dark, FOOT_SHARE * dark + FOOT_STD
    feet = usual + deviation * np.linspace(-2.0, 2.0, 5)
    if feet[-1] <= 0.0:
        return np.zeros(1)
    return np.array([usual]) if feet[0] > SPAN else np.maximum(feet, 0.0)


def _side(grey: Array, feet: Array, plate_grey: float, noise: float, scale: float) -> Side | None:
    """Return a side from its profiles; None if too much of it is outside the image."""
    inside = np.asarray(np.isfinite(grey).all(axis=0))
    if not inside[ACROSS <= LEAST_IN_VIEW].all():
        return None
    last = int(np.flatnonzero(inside)[-1]) if inside.all() else int(np.argmin(inside)) - 1
    grey = np.where(np.arange(len(ACROSS)) > last, grey[:, last : last + 1], grey)
    level = np.median(grey, axis=0)
    level = np.convolve(np.pad(level, 2, mode="edge"), np.full(5, 0.2), mode="valid")
    hidden = np.where(np.arange(len(ACROSS)) > last, 1.0, 0.0)
    foot = float(feet[len(feet) // 2])
    if foot > WIDE_FACE:
        hidden = np.maximum(hidden, 1.0 / (1.0 + np.exp(-(ACROSS - foot + BEFORE_FOOT) / SOFT)))
    top = float(np.median(grey[:, 2:8]))
    return Side(grey, whitening(level, hidden, noise, scale), feet, top, plate_grey)


def _points(size: float, k: int) -> Array:
    """Points in the top's plane across the pieces of side k, (pieces, n, along, 2) m."""
    outward = OUTWARD[k]
    tangent = np.array([-outward[1], outward[0]])
    ends = np.linspace(-size / 2.0 + CORNER, size / 2.0 - CORNER, PIECES + 1)
    count = max(round((ends[1] - ends[0]) / PITCH), 1)
    along = ends[:-1, None] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    return np.asarray(
        (size / 2.0 + ACROSS)[None, :, None, None] * outward + along[:, None, :, None] * tangent
    )


def _ring(width: float, eye: Array) -> Array:
    """Points (n, 2) m of the plate beside a place, on the two sides that the cube does not hide."""
    along = np.linspace(-width / 2.0, width / 2.0, 41)
    points = []
    for k in np.argsort(OUTWARD @ eye[:2])[2:]:
        tangent = np.array([-OUTWARD[k][1], OUTWARD[k][0]])
        points.append((width / 2.0 + RING)[:, None, None] * OUTWARD[k] + along[None, :, None] * tangent)
    return np.concatenate(points).reshape(-1, 2)


def _level(view: PlateView, points: Array) -> float:
    """Median grey level at points (n, 2) m; NaN if none is in the image."""
    grey = view.at(points)
    grey = grey[np.isfinite(grey)]
    return float(np.median(grey)) if len(grey) else np.nan
