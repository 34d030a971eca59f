"""Decide whether a hole holds a cube, by the borders in the image: those of a cube or those of an empty pocket.

`hole_borders` predicts where each state has a step of grey. `seen_stations` finds where the image shows one. No colour
or brightness is assumed, so dark cubes, shadows and uneven light do not matter.

The score compares the borders that lie where the other state has a smooth surface. The visible part of a border is
evidence for its state, strong if steps rarely appear by accident. The invisible part is evidence against it, weak if
such borders are often invisible. The better state must also show every border that it requires. Otherwise something
else stands in the hole or hides it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_DEPTH, POCKET_MOUTH
from arm.poses import BoardPose
from arm.se3 import Array, Bools, apply, inverse, skew
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.occupancy.edge_response import (
    GAP,
    WINDOW,
    PlateView,
    StepLimits,
    mean_step,
    plate_view,
    rough_part,
    seen_stations,
    step_limits,
)
from vision.occupancy.expected_edges import Border, Kind, hole_borders, marker_squares, seen_on_plate

LEAST_CONTRAST = 25.0  # grey levels between a marker's black and white; below, every hole is unsure
REACH = 1.6 * POCKET_MOUTH  # m around a hole; includes a cube's top seen at a slant
TOLERANCE = 0.5e-3  # m: a cube's play in its pocket, and the accuracy of boards
MOST_TOLERANCE = 1.5e-3  # m: borders are not searched farther away
MOST_STD = 0.9e-3  # m, of a cube's top across the camera's ray: above it, the states' borders are confused
BLUR = 0.4e-3  # m, reach of a blurred border
LEAST_STATIONS = 4  # per border; a border with fewer is ignored
LEAST_MARKER = 0.25  # fraction of a marker and its white border that must be visible to show black and white
SURE = 0.95  # smallest score of a cube; 1 - SURE is the largest score of an empty hole
EVEN = 0.01  # largest fraction of an even patch with steps of grey
EVEN_SIDE = 0.04  # the same beside a mouth, where one edge covers a larger fraction of the patch
FLOOR_RADII = (10e-3, 12e-3, 14e-3)  # m, around the finger hole
MOUTH_BANDS = ((-7e-3, -0.7e-3), (0.8e-3, 4.9e-3))  # m outwards from a side of the mouth
MOST_FAINT = 2  # sides of an empty pocket that may be invisible
RIM_STEP = 0.4  # smallest step at a finger hole's rim, relative to the grey of the floor around it
ABSENT = 0.3  # of that step: below, there is no finger hole


@dataclass(frozen=True)
class Weight:
    """Evidence of one kind of border.

    Attributes:
        invisible: probability that a border does not show (unfavourable light or similar colours).
        accident: probability that a step of grey shows where there is no border (the edge of a shadow).
    """

    invisible: float
    accident: float


# from rendered scenes whose seeds bench/occupancy.py does not use, rounded towards caution
WEIGHTS: Mapping[Kind, Weight] = {
    "top": Weight(0.25, 0.05),
    "upright": Weight(0.5, 0.1),
    "mouth": Weight(0.1, 0.05),
    "floor": Weight(0.4, 0.1),
    "rim": Weight(0.02, 0.002),
}

LIGHT = "light: too dark, too bright or too little contrast on the board's markers"
NO_MARKER = "no marker of the board is in the image, so the light cannot be judged"
OUT = "the hole is not completely in the image"
POSE = "the board's pose is too uncertain"
FAINT = "poor contrast: neither a cube's nor an empty pocket's borders show well enough"
OTHER = "neither a seated cube nor an empty hole: something is across it or hides it, or a shadow's edge cuts it up"


HoleState = Literal["cube", "empty", "unsure"]


@dataclass(frozen=True)
class Occupancy:
    """State of a hole.

    Attributes:
        state: "cube", "empty", or "unsure" if the image does not decide.
        score: probability of a seated cube, by its borders, assuming that the hole is otherwise empty; 0.5 if the
            borders were not evaluated, None if the state is not from an image.
        reason: why the state is unsure; otherwise empty.
    """

    state: HoleState
    score: float | None = None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Found:
    """A border, and whether the image shows it at its stations (n,): 1, 0, or NaN if covered or outside the image."""

    border: Border
    shows: Array

    def fraction(self, of: Bools) -> float:
        """Visible fraction of the stations `of` (n,); NaN if there are too few."""
        values = self.shows[of & np.isfinite(self.shows)]
        return float(values.mean()) if len(values) >= LEAST_STATIONS else np.nan


def hole_occupancy(
    images: Sequence[Image], camera: Camera, pose: BoardPose, index: int, cube_size: float
) -> Occupancy:
    """Classify hole `index` (0 to 3) of a detected board.

    Args:
        images: taken at one moment, grey or BGR, of the camera's size.
        camera: the camera that took them.
        pose: pose of the board; a large covariance makes the hole unsure.
        index: number of the hole.
        cube_size: edge of a cube, m.
    """
    hole = pose.holes[index]
    eye = apply(inverse(pose.T_base_board), camera.T_base_camera[:3, 3])
    view = plate_view(images, camera, hole.T_base_hole, REACH)
    if eye[2] <= 2.0 * cube_size or view is None:
        return Occupancy("unsure", 0.5, OUT)
    contrast = _contrast(images, camera, pose)
    if contrast is None:
        return Occupancy("unsure", 0.5, NO_MARKER)
    if contrast < LEAST_CONTRAST:
        return Occupancy("unsure", 0.5, LIGHT)
    top = np.array([0.0, 0.0, cube_size - CUBE_SEAT_DEPTH])
    std = _sideways_std(hole.T_base_hole, hole.covariance, top, camera)
    if not std <= MOST_STD:
        return Occupancy("unsure", 0.5, POSE)
    tolerance = float(np.clip(2.0 * std, TOLERANCE, MOST_TOLERANCE))
    borders = hole_borders(pose.board, index, eye, cube_size, 2.0 * tolerance + GAP + WINDOW + BLUR)
    limits = step_limits(view, contrast, tolerance)
    cube, empty = ([_found(b, view, limits) for b in of_state] for of_state in borders)
    rim = empty[-1]
    if not all(np.isfinite(found.shows[found.border.clear]).all() for found in empty):
        return Occupancy("unsure", 0.5, OUT)
    eye = eye - pose.board.holes[index]
    rim_counts = _rim_counts(view, rim.border, eye, limits)
    score = 1.0 / (1.0 + np.exp(_evidence(empty, rim_counts) - _evidence(cube, rim_counts)))
    even = rough_part(view, _top_patch(cube_size, eye), limits) < EVEN
    if 1.0 - SURE < score < SURE:
        return Occupancy("unsure", float(score), FAINT if even else OTHER)
    if score >= SURE:
        why = _why_no_cube(_fractions(cube, "top"), rim.fraction(rim.border.telling), even)
        return Occupancy("unsure" if why else "cube", float(score), why)
    even_sides = [
        max(rough_part(view, p, limits) for p in both) < EVEN_SIDE
        for both in _beside_mouth(pose.board.pocket[0])
    ]
    sides = np.fmax(_fractions(empty, "mouth"), _fractions(empty, "floor"))
    why = _why_not_empty(sides, rim.fraction(rim.border.clear), np.array(even_sides))
    return Occupancy("unsure" if why else "empty", float(score), why)


def _contrast(images: Sequence[Image], camera: Camera, pose: BoardPose) -> float | None:
    """Grey levels between black and white of the board's visible markers; None if no marker is visible enough.

    The image's edge may cut off part of a marker's white border, which detection does not need.
    """
    greys = []
    centres, grid = marker_squares(pose.board)
    for centre in centres:
        T = pose.T_base_board.copy()
        T[:3, 3] = apply(pose.T_base_board, centre)
        view = plate_view(images, camera, T, float(grid.max()) * 1.5)
        if view is None:
            continue
        grey = view.at(grid)
        shown = np.isfinite(grey)
        if shown.mean() >= LEAST_MARKER:
            greys.append(grey[shown])
    if not greys:
        return None
    black, white = np.percentile(np.concatenate(greys), (10.0, 90.0))
    return float(white - black)


def _sideways_std(T_base_hole: Array, covariance: Array, point: Array, camera: Camera) -> float:
    """Largest standard deviation of a point (3,) m of the hole frame across the camera's ray to it, m."""
    J = np.concatenate([np.eye(3), -skew(point)], axis=1)
    ray = apply(inverse(T_base_hole), camera.T_base_camera[:3, 3]) - point
    ray /= np.linalg.norm(ray)
    across = np.eye(3) - np.outer(ray, ray)
    if not np.isfinite(covariance).all():
        return np.inf
    return float(np.sqrt(np.linalg.eigvalsh(across @ J @ covariance @ J.T @ across)[-1]))


def _found(border: Border, view: PlateView, limits: StepLimits) -> _Found:
    shows = np.full(len(border.points), np.nan)
    clear = border.clear
    shows[clear] = seen_stations(
        view, border.points[clear], border.outward[clear], limits, ring=border.kind == "rim"
    )
    return _Found(border, shows)


def _evidence(borders: Sequence[_Found], rim_counts: bool) -> float:
    """Log likelihood ratio of a state by its own borders."""
    total = 0.0
    for found in borders:
        visible = found.fraction(found.border.telling)
        if np.isnan(visible):
            continue
        weight = WEIGHTS[found.border.kind]
        against = np.log(weight.invisible) if found.border.kind != "rim" or rim_counts else 0.0
        telling = found.border.telling.sum() / len(found.border.points)
        total += telling * (visible * -np.log(weight.accident) + (1.0 - visible) * against)
    return float(total)


def _rim_counts(view: PlateView, rim: Border, eye: Array, limits: StepLimits) -> bool:
    """Whether an invisible rim is evidence against an empty hole: it would show if it were there.

    A finger hole is darker than the floor around it. On a dark floor single stations do not show its rim, but the mean
    step over all stations may still prove that there is no finger hole.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    floor = np.concatenate([r * ring for r in FLOOR_RADII])
    expected = RIM_STEP * float(np.nanmedian(view.at(seen_on_plate(floor, -POCKET_DEPTH, eye))))
    if expected > 1.5 * limits.least:
        return True
    noise = limits.noise / np.sqrt(len(rim.points))
    absent = abs(mean_step(view, rim.points, rim.outward)) < ABSENT * expected
    return bool(absent and expected > max(10.0 * noise, 0.5 * limits.smooth))


def _top_patch(cube_size: float, eye: Array) -> Array:
    """Points (n, n, 2) inside a cube's top, projected to the plate's plane."""
    half = cube_size / 2.0 - 2.0 * WINDOW
    side = np.arange(-half, half, WINDOW)
    patch = np.stack(np.meshgrid(side, side), axis=-1)
    return seen_on_plate(patch, cube_size - CUBE_SEAT_DEPTH, eye)


def _beside_mouth(mouth: float) -> list[tuple[Array, Array]]:
    """Points (n, m, 2) inside and outside each side of the mouth, in order of the sides, away from corners."""
    along = np.arange(-0.28 * mouth, 0.28 * mouth, WINDOW)
    quarter_turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of rows
    both = []
    for low, high in MOUTH_BANDS:
        across = mouth / 2.0 + np.arange(low, high, WINDOW)
        first = np.stack(np.meshgrid(along, -across), axis=-1)  # the first side has y below 0
        both.append([first @ np.linalg.matrix_power(quarter_turn, k) for k in range(4)])
    return list(zip(*both, strict=True))


def _fractions(borders: Sequence[_Found], kind: Kind) -> Array:
    """Visible fraction of the clear stations of each border of that kind."""
    return np.array([found.fraction(found.border.clear) for found in borders if found.border.kind == kind])


def _why_no_cube(sides: Array, rim: float, even: bool) -> str:
    """Reason why it is no whole cube; empty if enough of the top's sides is visible (less is enough if it is even)."""
    sides = sides[np.isfinite(sides)]
    if len(sides) < 3:
        return OUT
    if rim > 0.4:
        return OTHER
    most = sides.min() > 0.6 or (sides > 0.85).sum() >= 3 or (sides.min() > 0.3 and sides.mean() > 0.7)
    if most or (even and sides.mean() > 0.42):
        return ""
    return FAINT if even else OTHER


def _why_not_empty(sides: Array, rim: float, even_sides: Bools) -> str:
    """Reason why it is no empty pocket; empty if the rim is visible, and each side of the mouth or of the floor.

    A few sides may be invisible if nothing lies across them: at a slant, the floor begins at the mouth and may look
    like the plate.
    """
    faint = ~(sides > 0.7)
    if rim > 0.7 and (not faint.any() or (faint.sum() <= MOST_FAINT and even_sides[faint].all())):
        return ""
    return OTHER
