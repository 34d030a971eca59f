"""Is there a cube in a hole? Decided by which borders the image shows: those of a cube, or those of an empty pocket.

`hole_borders` says where either state must show steps of grey, `grey_steps` how much of them shows. No colour and no
brightness is taken for granted, so that dark cubes, shadows and uneven light do not matter. Borders that lie where the
other state has a smooth surface are weighed against each other: each is seen in part, and a seen one speaks for its
state as much as an accident is unlikely, an unseen one against it as much as it is seldom invisible. What the winner
needs must then be there as a whole, else something else stands in the hole or hides it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from arm.board import CUBE_SEAT_DEPTH, POCKET_DEPTH, POCKET_MOUTH
from arm.poses import BoardPose, hole_poses
from arm.se3 import Array, apply, inverse, skew
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
from vision.occupancy.expected_edges import (
    Border,
    Kind,
    hole_borders,
    marker_squares,
    seen_on_plate,
)

LEAST_CONTRAST = 25.0  # grey levels between a marker's black and white, else nothing is sure
REACH = 1.6 * POCKET_MOUTH  # around a hole, m: a cube's top seen at a slant is within
TOLERANCE = 0.5e-3  # a cube's play in its pocket, and the boards' own accuracy, m
MOST_TOLERANCE = 1.5e-3  # borders are not looked for farther away, m
MOST_STD = (
    0.9e-3  # of a cube's top across the camera's ray, m: beyond, borders of both states are not told apart
)
BLUR = 0.4e-3  # how far a blurred border reaches, m
LEAST_STATIONS = 4  # of a border, else it is left out
LEAST_MARKER = (
    0.25  # part of a marker with its white border that must be in the image: it then shows black and white
)
SURE = 0.95  # score of a cube; 1 minus it that of an empty hole
EVEN = 0.01  # part of an even patch at which a step of grey may be
EVEN_SIDE = 0.04  # the same beside a mouth, where an edge along or across the patch takes more
FLOOR_RADII = (10e-3, 12e-3, 14e-3)  # around the finger hole, m
MOUTH_BANDS = ((-7e-3, -0.7e-3), (0.8e-3, 4.9e-3))  # from a side of the mouth outwards, m
MOST_FAINT = 2  # sides of an empty pocket that need not show
RIM_STEP = 0.4  # a finger hole is at least that much darker than the floor around it
ABSENT = 0.3  # part of that step below which there is no finger hole


@dataclass(frozen=True)
class Weight:
    """How telling one border of a kind is.

    Attributes:
        invisible: probability that it does not show though it is there (light falls so, or colours are alike).
        accident: probability that a step of grey shows there though it is not (a shadow's edge).
    """

    invisible: float
    accident: float


# from rendered scenes of seeds of their own (bench/occupancy.py), rounded towards caution
WEIGHTS: Mapping[Kind, Weight] = {
    "top": Weight(0.25, 0.05),
    "upright": Weight(0.5, 0.1),
    "mouth": Weight(0.1, 0.05),
    "floor": Weight(0.4, 0.1),
    "rim": Weight(0.02, 0.002),
}

LIGHT = "light: too dark, too bright or too little contrast on the board's markers"
NO_MARKER = "no marker of the board is in the image, so that its light is not known"
OUT = "the hole is not whole in the image"
POSE = "the board's pose is not known well enough"
FAINT = "poor contrast: too little shows of a cube's borders and of an empty pocket's"
OTHER = "neither a seated cube nor an empty hole: something is across it or hides it, or a shadow's edge cuts it up"


@dataclass(frozen=True)
class Occupancy:
    """What is in a hole.

    Attributes:
        state: "cube", "empty", or "unsure" where the image does not say.
        score: probability of a cube if it is either a seated cube or an empty hole, from the borders seen; 0.5 where
            they were not looked at.
        reason: why it is unsure; empty if it is sure.
    """

    state: Literal["cube", "empty", "unsure"]
    score: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Seen:
    """A border and at which of its stations it shows (n,): 1, 0, or NaN where it is not clear or not in the image."""

    border: Border
    shows: npt.NDArray[np.float64]

    def part(self, of: npt.NDArray[np.bool_]) -> float:
        """Part of those stations that shows; NaN if there are too few."""
        values = self.shows[of & np.isfinite(self.shows)]
        return float(values.mean()) if len(values) >= LEAST_STATIONS else np.nan


def hole_occupancy(
    images: Sequence[Image], camera: Camera, pose: BoardPose, index: int, cube_size: float
) -> Occupancy:
    """What stands in hole `index` (0 to 3) of a board that was found.

    Args:
        images: photographs of one moment, grey or BGR, of the camera's size.
        camera: that took them.
        pose: of the board, with its covariance: what is known badly makes holes unsure.
        index: of the hole.
        cube_size: edge of a cube, m.
    """
    hole = hole_poses(pose)[index]
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
    cube = [_look_at(b, view, limits) for b in borders.cube]
    empty = [_look_at(b, view, limits) for b in borders.empty]
    if not _whole(empty):
        return Occupancy("unsure", 0.5, OUT)
    eye = eye - pose.board.holes[index]
    rim_counts = _rim_counts(view, borders.of("rim")[0], eye, limits)
    score = 1.0 / (1.0 + np.exp(_evidence(empty, rim_counts) - _evidence(cube, rim_counts)))
    even = rough_part(view, _top_patch(cube_size, eye), limits) < EVEN
    if 1.0 - SURE < score < SURE:
        return Occupancy("unsure", float(score), FAINT if even else OTHER)
    if score >= SURE:
        rim = empty[-1].part(empty[-1].border.telling)
        why = _why_no_cube(_parts(cube, "top"), rim, even)
        return Occupancy("unsure" if why else "cube", float(score), why)
    even_sides = [
        max(rough_part(view, p, limits) for p in both) < EVEN_SIDE
        for both in _beside_mouth(pose.board.pocket[0])
    ]
    sides = np.fmax(_parts(empty, "mouth"), _parts(empty, "floor"))
    why = _why_not_empty(sides, _parts(empty, "rim")[0], np.array(even_sides))
    return Occupancy("unsure" if why else "empty", float(score), why)


def _contrast(images: Sequence[Image], camera: Camera, pose: BoardPose) -> float | None:
    """Grey levels between black and white of what the image shows of the board's markers; None if it shows neither.

    A marker at the image's edge may have its white border outside: boards fill the view, and its corners are measured
    all the same.
    """
    greys = []
    for square in marker_squares(pose.board):
        T = pose.T_base_board.copy()
        T[:3, 3] = apply(pose.T_base_board, square.centre)
        view = plate_view(images, camera, T, float(np.abs(square.points).max()) * 1.5)
        if view is None:
            continue
        grey = view.at(square.points)
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


def _look_at(border: Border, view: PlateView, limits: StepLimits) -> _Seen:
    shows = np.full(len(border.points), np.nan)
    clear = border.clear
    shows[clear] = seen_stations(
        view, border.points[clear], border.outward[clear], limits, ring=border.kind == "rim"
    )
    return _Seen(border, shows)


def _whole(seen: Sequence[_Seen]) -> bool:
    """No clear station of the hole's borders lies outside the image."""
    return all(np.isfinite(s.shows[s.border.clear]).all() for s in seen)


def _evidence(seen: Sequence[_Seen], rim_counts: bool) -> float:
    """How much a state's own borders speak for it (logarithm of a likelihood ratio)."""
    total = 0.0
    for one in seen:
        part = one.part(one.border.telling)
        if np.isnan(part):
            continue
        weight = WEIGHTS[one.border.kind]
        against = np.log(weight.invisible) if one.border.kind != "rim" or rim_counts else 0.0
        telling = one.border.telling.sum() / len(one.border.points)
        total += telling * (part * -np.log(weight.accident) + (1.0 - part) * against)
    return float(total)


def _rim_counts(view: PlateView, rim: Border, eye: Array, limits: StepLimits) -> bool:
    """Whether a finger hole's rim would show if it were there, or surely is not there.

    The hole is darker than the floor around it; where that is dark itself, single stations do not show it, but the
    mean of all may tell that there is none.
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
    """Points (n, n, 2) inside a cube's top as it is seen on the plate's plane."""
    half = cube_size / 2.0 - 2.0 * WINDOW
    side = np.arange(-half, half, WINDOW)
    patch = np.stack(np.meshgrid(side, side), axis=-1)
    return seen_on_plate(patch, cube_size - CUBE_SEAT_DEPTH, eye)


def _beside_mouth(mouth: float) -> list[tuple[Array, Array]]:
    """Points (n, m, 2) inside and outside each side of the mouth, in the order of its sides, off their corners."""
    along = np.arange(-0.28 * mouth, 0.28 * mouth, WINDOW)
    quarter_turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # of rows
    both = []
    for low, high in MOUTH_BANDS:
        across = mouth / 2.0 + np.arange(low, high, WINDOW)
        first = np.stack(np.meshgrid(along, -across), axis=-1)  # the first side has y below 0
        both.append([first @ np.linalg.matrix_power(quarter_turn, k) for k in range(4)])
    return list(zip(*both, strict=True))


def _parts(seen: Sequence[_Seen], kind: Kind) -> Array:
    """Of each border of that kind, the part of its clear stations that shows."""
    return np.array([s.part(s.border.clear) for s in seen if s.border.kind == kind])


def _why_no_cube(sides: Array, rim: float, even: bool) -> str:
    """Empty if a whole cube's top is there: most of its four sides; of an even top less (colours may be alike)."""
    sides = sides[np.isfinite(sides)]
    if len(sides) < 3:
        return OUT
    if rim > 0.4:
        return OTHER
    most = sides.min() > 0.6 or (sides > 0.85).sum() >= 3 or (sides.min() > 0.3 and sides.mean() > 0.7)
    if most or (even and sides.mean() > 0.42):
        return ""
    return FAINT if even else OTHER


def _why_not_empty(sides: Array, rim: float, even_sides: npt.NDArray[np.bool_]) -> str:
    """Empty if a whole empty pocket is there: the finger hole's rim, and each side of the mouth or of the floor.

    Sides may be faint (seen at a slant, the floor begins at the mouth and may look like the plate), if nothing lies
    across them.
    """
    faint = ~(sides > 0.7)
    if rim > 0.7 and (not faint.any() or (faint.sum() <= MOST_FAINT and even_sides[faint].all())):
        return ""
    return OTHER
