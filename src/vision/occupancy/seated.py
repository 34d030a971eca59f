"""Decide whether a cube is properly seated: an occupied hole may hold one that is half seated, on the rim, or too high.

A cube is confirmed if the sides of its top lie where those of a seated cube do, and not where those of a higher one
would: centred on its place, aligned with it, square, and as wide as expected at that height. The best estimate of the
cube's own width comes from a look before it was moved. Height, width and play are integrated over the likelihood of all
four sides (`vision.occupancy.cube_top`). So an invisible side has no influence, and the others are weighted by their
uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import logsumexp, softmax

from arm.board import POCKET_DEPTH, POCKET_FLOOR, POCKET_MOUTH, seat_depth
from arm.se3 import Array
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.occupancy.cube_fit import PLACES
from vision.occupancy.cube_top import CubeTop, EmptyPlace, measure_top

LIFT = 4e-3  # m: a cube that is this high is certainly distinguished from a seated one
LEANING = 2.8e-3  # m, height of the middle of a top that leans on its pocket's rim, raised side invisible
MOST_LIFT = 2.0e-3  # m, largest measured height of a seated cube
SURE = 3.0  # standard deviations; a seated cube may be measured as many of them too low
MOST_ASIDE = 0.8e-3  # m, largest offset of a top's middle
PLAY = 0.15e-3  # m, standard deviation of a seated cube's place along x and y, with the tolerances of boards
MOST_TURN = np.radians(3.0)
MOST_TWIST = 16.0  # log likelihood ratio of sides with a rotation each
MOST_UNLIKELY = 14.0  # log likelihood of four independent sides above that of the best seated or raised cube
ALL_AGREE = 9.0  # the same, if no side is mistaken
MOST_STD = {4: 1.3e-3, 3: 1.0e-3, 2: 0.6e-3}  # m, largest for a known height, by the number of visible sides
LEAST_SHOWN = 10.0  # log likelihood ratio of a visible side to no side
LEAST_THERE = -40.0  # the same; below it, there is certainly no side
MISTAKEN = 12.0  # log likelihood against mistaking a foot, a mouth or a border for a side
OWN_STD = 4e-6  # m, of a width from another look: errors that the two looks do not share
LIFTS: Array = np.arange(-8e-3, 16.05e-3, 0.1e-3)
WIDTHS: Array = np.linspace(-3.5, 3.5, 21)  # standard deviations
PLAYS: Array = np.linspace(-4.0, 4.0, 81)  # standard deviations
FREE_PLAY = 1.5e-3  # m, largest offset of a top from its place
PAIRS = ((3, 1), (0, 2))  # opposite sides, along x and y
BEYOND = 5.0  # log likelihood of the least likely place in the window, above that of a place outside


@dataclass(frozen=True)
class CubeWidth:
    """Width of a cube and its standard deviation, m."""

    value: float
    std: float


@dataclass(frozen=True)
class Seating:
    """Whether a cube is seated at its place.

    Attributes:
        state: "seated" and "off" are certain.
        reason: why it is off or unsure; empty if it is seated.
        lift: height of its top above a seated one's, m; NaN if unknown.
        lift_std: standard deviation of `lift`, m.
    """

    state: Literal["seated", "off", "unsure"]
    reason: str = ""
    lift: float = float("nan")
    lift_std: float = float("nan")


def seating(top: CubeTop | None, cube: CubeWidth) -> Seating:
    """Judge a top, measured as if it lay at a seated cube's height.

    Args:
        top: the measured top; None if it could not be measured.
        cube: width of the cube.
    """
    if top is None:
        return Seating("unsure", "its top is not completely in the image")
    if abs(top.turn) > MOST_TURN:
        return Seating("off", f"its top is rotated by {np.degrees(top.turn):.1f} deg")
    if top.twist > MOST_TWIST:
        return Seating(
            "unsure", "the sides of its top do not form a square: it leans, or something lies across it"
        )
    if (top.shown < LEAST_THERE).any():
        return Seating("unsure", "the image does not show the top of an upright cube")
    visible = int((top.shown > LEAST_SHOWN).sum())
    if not _shows(top):
        return Seating("unsure", "the sides of its top do not show clearly enough")
    width = CubeWidth(cube.value, float(np.hypot(cube.std, OWN_STD)))
    log, best = _at_heights(top, width, LIFTS)
    lift, std = _moments(LIFTS, np.asarray(logsumexp(log, axis=1)))
    if best < -MOST_UNLIKELY or (best < -ALL_AGREE and visible < len(top.shown)):
        aside = _aside(top, width)
        if aside > MOST_ASIDE:
            return Seating("off", f"its top is {1e3 * aside:.1f} mm from a seated one's, sideways", lift, std)
        reason = "the sides of its top are not where those of a seated or higher cube would be"
        return Seating("unsure", reason, lift, std)
    height = f"its top is {1e3 * lift:+.1f} mm from a seated one's height, std {1e3 * std:.1f} mm"
    known = std <= MOST_STD[visible] and -max(MOST_LIFT, SURE * std) <= lift <= MOST_LIFT
    if known and lift + SURE * std <= (LIFT if visible == len(top.shown) else LEANING):
        return Seating("seated", "", lift, std)
    return Seating("off" if abs(lift) - SURE * std > 0.0 else "unsure", height, lift, std)


def width_of(top: CubeTop | None, cube: CubeWidth) -> CubeWidth | None:
    """Return the width of a seated cube from its top and the prior `cube`; None if the top does not determine it."""
    if top is None or abs(top.turn) > MOST_TURN or top.twist > MOST_TWIST or not _shows(top):
        return None
    log, best = _at_heights(top, cube, np.zeros(1))
    if best < -MOST_UNLIKELY:
        return None
    return CubeWidth(*_moments(cube.value + cube.std * WIDTHS, log[0]))


def _shows(top: CubeTop) -> bool:
    """Whether at least one side is visible along x and one along y."""
    return all(max(top.shown[low], top.shown[high]) > LEAST_SHOWN for low, high in PAIRS)


def _at_heights(top: CubeTop, cube: CubeWidth, lifts: Array) -> tuple[Array, float]:
    """Log likelihood of heights and widths, (lifts, widths), with play integrated out; and the best over all three.

    Both are relative to free sides. A higher top looks wider and farther from the point below the camera. A wider cube
    also sits higher: `top.rise`.
    """
    widths = cube.value + cube.std * WIDTHS
    height = lifts[:, None] + top.rise * (widths - top.size)
    larger = top.distance / (top.distance - height)  # factor of the projection to the plane of a seated top
    half = (widths * larger - top.size) / 2.0
    plays = PLAY * PLAYS
    log = np.broadcast_to(-0.5 * WIDTHS**2, half.shape)
    best, sides = log, _likely(top)
    for axis, (low, high) in enumerate(PAIRS):
        shift = -top.slope[axis] * top.distance * (larger - 1.0)
        aside = shift[..., None] + larger[..., None] * plays
        one = -0.5 * (plays / PLAY) ** 2
        one = one + _at(sides[high], half[..., None] + aside) + _at(sides[low], half[..., None] - aside)
        best = best + one.max(axis=-1)
        log = log + logsumexp(one, axis=-1) - np.log(one.shape[-1])
    return log, float(best.max())


def _likely(top: CubeTop) -> list[Array]:
    """Log likelihood of each side at `PLACES`, in case something else was mistaken for it.

    Three sides outvote one mistaken side. Two mistaken sides are not the top of a cube.
    """
    return [
        np.logaddexp(side, -min(max(shown, 0.0), MISTAKEN))
        for side, shown in zip(top.sides, top.shown, strict=True)
    ]


def _at(side: Array, places: Array) -> Array:
    beyond = float(side.min()) - BEYOND
    return np.asarray(np.interp(places, PLACES, side, left=beyond, right=beyond))


def _aside(top: CubeTop, cube: CubeWidth) -> float:
    """Best-fitting offset of the middle of a seated cube's top, m; 0 if none fits."""
    plays, sides = np.linspace(-FREE_PLAY, FREE_PLAY, 121), _likely(top)
    found = []
    for low, high in PAIRS:
        half = (cube.value - top.size) / 2.0
        one = _at(sides[high], half + plays) + _at(sides[low], half - plays)
        if one.max() < -MOST_UNLIKELY:
            return 0.0
        found.append(abs(float(plays[np.argmax(one)])))
    return max(found)


def _moments(values: Array, log: Array) -> tuple[float, float]:
    """Mean and standard deviation of values with these log likelihoods."""
    weights = softmax(log)
    mean = float(weights @ values)
    return mean, float(np.sqrt(weights @ (values - mean) ** 2))


@dataclass(frozen=True, eq=False)
class Sight:
    """Images of one moment in which cubes are measured.

    Attributes:
        images, camera: the images, and the camera that took them.
        cube: nominal width of a cube, with its tolerance.
        pocket: widths of a pocket's mouth and of its floor, m.
    """

    images: Sequence[Image]
    camera: Camera
    cube: CubeWidth
    pocket: tuple[float, float] = (POCKET_MOUTH, POCKET_FLOOR)

    def in_hole(self, T_base_hole: Array, empty: EmptyPlace | None = None) -> CubeTop | None:
        """Measure the top of a cube in a hole, near that of a seated one; `empty` is the hole without the cube."""
        size, (mouth, floor) = self.cube.value, self.pocket
        height, rise = size - seat_depth(size, self.pocket), 1.0 + POCKET_DEPTH / (mouth - floor)
        return measure_top(self.images, self.camera, T_base_hole, size, height, mouth, rise, empty)

    def on_plane(self, T_base_place: Array, empty: EmptyPlace | None = None) -> CubeTop | None:
        """Measure the top of a cube that stands on a plane at a place, aligned with it."""
        size = self.cube.value
        return measure_top(self.images, self.camera, T_base_place, size, size, None, 1.0, empty)

    def empty(self, T_base_place: Array) -> EmptyPlace:
        """Return a place that is empty in these images."""
        return EmptyPlace(self.images, self.camera, T_base_place)

    def shows(self, points: Array) -> bool:
        """Whether points (n, 3) m of the base frame are in the image."""
        pixels = self.camera.project_base(points)
        with np.errstate(invalid="ignore"):
            return bool(((pixels > 0.0) & (pixels < np.array(self.camera.size) - 1.0)).all())
