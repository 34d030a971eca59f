"""Does a cube surely sit where it should? What "something is in the hole" does not tell: half seated, on the rim, high.

A cube is confirmed if its top is where a seated cube's top is: over the middle of its place, turned like it, square,
and as wide as at that height. How wide the cube itself is, is known best from a look at the same cube before it was
moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_MOUTH
from arm.se3 import Array
from vision.camera import Camera
from vision.cube_top import CubeTop, measure_top
from vision.frames import Image

LIFT = 4e-3  # m: a cube that stands as high as this is surely told from a seated one
MOST_LIFT = 1.5e-3  # m, that a seated one's measured height may differ
SURE = 3.0  # standard deviations
MOST_ASIDE = 1.0e-3  # m, of a top's middle
PLAY = 0.25e-3  # standard deviation of a seated cube's place, with what boards are made to, m
MOST_UNLIKELY = 12.0  # squared deviations, of 2 degrees of freedom
MOST_TURN = np.radians(3.0)
MOST_UNLIKE = 0.08e-3  # m by which both widths of a square may differ, beside their noise


@dataclass(frozen=True)
class CubeWidth:
    """How wide a cube is, with its standard deviation; m."""

    value: float
    std: float


@dataclass(frozen=True)
class Seating:
    """Whether a cube sits at its place.

    Attributes:
        state: "seated" and "off" are sure.
        reason: why it is not seated, or not sure; empty if it is.
        lift: of its top over a seated one's, m; NaN where it is not known.
        lift_std: its standard deviation, m.
    """

    state: Literal["seated", "off", "unsure"]
    reason: str = ""
    lift: float = float("nan")
    lift_std: float = float("nan")


def width_of(top: CubeTop | None) -> CubeWidth | None:
    """A cube's width by its top, if it sits; None where that does not show, or its two widths differ."""
    if top is None:
        return None
    if abs(top.widths[0] - top.widths[1]) > MOST_UNLIKE + SURE * np.hypot(*top.stds):
        return None
    weight = top.stds**-2.0
    return CubeWidth(float(weight @ top.widths / weight.sum()), float(weight.sum() ** -0.5))


def seating(top: CubeTop | None, cube: CubeWidth) -> Seating:
    """Judge a top, measured as if it lay at a seated cube's height.

    Args:
        top: as measured, None where it could not be.
        cube: how wide the cube is.
    """
    if top is None:
        return Seating("unsure", "its top is not whole in the image")
    if abs(top.turn) > MOST_TURN:
        return Seating("off", f"its top is turned by {np.degrees(top.turn):.1f} deg")
    seen = width_of(top)
    if seen is None:
        return Seating("unsure", "the sides of its top do not show well enough, or are not those of a square")
    lifts, weights = _lifts(top, seen, cube)
    lift = float(weights @ lifts / weights.sum())
    std = float(weights.sum() ** -0.5)
    aside = float(np.abs(top.centre + lift * top.slope).max())
    if aside > MOST_ASIDE:
        return Seating("off", f"its top is {1e3 * aside:.1f} mm aside of where a seated one's is", lift, std)
    told = f"its top is {1e3 * lift:+.1f} mm from a seated one's height, std {1e3 * std:.1f} mm"
    if weights @ (lifts - lift) ** 2 > MOST_UNLIKELY:
        return Seating("unsure", f"{told}, but its place and its size say different heights", lift, std)
    if abs(lift) <= MOST_LIFT and abs(lift) + SURE * std <= LIFT:
        return Seating("seated", "", lift, std)
    return Seating("off" if abs(lift) - SURE * std > 0.0 else "unsure", told, lift, std)


def _lifts(top: CubeTop, seen: CubeWidth, cube: CubeWidth) -> tuple[Array, Array]:
    """How high a top lies over a seated one's by its width and by its place along x and y, m; and 1/variance of each.

    A top that is higher is seen wider, and farther from the camera's foot: by `slope` a metre.
    """
    per_width = top.distance / cube.value
    by_width = (seen.value - cube.value) * per_width
    width_weight = 1.0 / (per_width**2 * (seen.std**2 + cube.std**2))
    slope = np.where(np.abs(top.slope) < 1e-6, 1e-6, top.slope)
    place_weight = slope**2 / (PLAY**2 + (top.stds / 2.0) ** 2)
    return np.array([by_width, *(-top.centre / slope)]), np.array([width_weight, *place_weight])


@dataclass(frozen=True, eq=False)
class Sight:
    """Photographs of one moment, to measure cubes in.

    Attributes:
        images, camera: the photographs, and what took them.
        cube: a cube by its nominal width and what that may be off.
    """

    images: Sequence[Image]
    camera: Camera
    cube: CubeWidth

    def in_hole(self, T_base_hole: Array) -> CubeTop | None:
        """The top of a cube in a hole, looked for where a seated one's is."""
        size = self.cube.value
        return measure_top(self.images, self.camera, T_base_hole, size, size - CUBE_SEAT_DEPTH, POCKET_MOUTH)

    def on_plane(self, T_base_place: Array) -> CubeTop | None:
        """The top of a cube that stands on a plane, at a place and turned like it."""
        return measure_top(self.images, self.camera, T_base_place, self.cube.value, self.cube.value, None)

    def shows(self, points: Array) -> bool:
        """Whether points (n, 3) m of the base frame are in the image."""
        pixels = self.camera.project_base(points)
        with np.errstate(invalid="ignore"):
            return bool(((pixels > 0.0) & (pixels < np.array(self.camera.size) - 1.0)).all())

    def known_width(self, top: CubeTop | None) -> CubeWidth:
        """A cube's width for a later look: by its top, if it sits as far as its nominal width tells; and by that."""
        seen = width_of(top)
        if seen is None or top is None or seating(top, self.cube).state == "off":
            return self.cube
        weights = np.array([seen.std, self.cube.std]) ** -2.0
        return CubeWidth(
            float(weights @ (seen.value, self.cube.value) / weights.sum()), float(weights.sum() ** -0.5)
        )
