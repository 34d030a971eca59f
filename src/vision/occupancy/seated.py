"""Does a cube surely sit where it should? What "something is in the hole" does not tell: half seated, on the rim, high.

A cube is confirmed if the sides of its top lie where a seated cube's do, and not where a higher one's would: about the
middle of its place, turned like it, square, and as wide as at that height. How wide the cube itself is, is known best
from a look at the same cube before it was moved. Height, width and play are integrated over the likelihood of all four
sides (`vision.occupancy.cube_top`), so that a side that does not show says nothing, and the rest is weighed
as it deserves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from arm.board import POCKET_DEPTH, POCKET_FLOOR, POCKET_MOUTH, seat_depth
from arm.se3 import Array
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.occupancy.cube_fit import PLACES
from vision.occupancy.cube_top import CubeTop, EmptyPlace, measure_top

LIFT = 4e-3  # m: a cube that stands as high as this is surely told from a seated one
LEANING = 2.8e-3  # m: so high is the top's middle of one that leans on its pocket's rim; its raised side does not show
MOST_LIFT = 2.0e-3  # m, that a seated one's measured height may differ
SURE = 3.0  # standard deviations; a lower top than a seated one's is no cube that stands high
MOST_ASIDE = 0.8e-3  # m, of a top's middle
PLAY = 0.15e-3  # standard deviation of a seated cube's place along x and y, with what boards are made to, m
MOST_TURN = np.radians(3.0)
MOST_TWIST = 16.0  # log likelihood, that sides may turn differently
MOST_UNLIKELY = (
    14.0  # log likelihood, of the best seated or raised cube below that of four sides by themselves
)
ALL_AGREE = 9.0  # the same, where no side is mistaken
MOST_STD = {4: 1.3e-3, 3: 1.0e-3, 2: 0.6e-3}  # m, of a height that is called known, by how many sides show
LEAST_SHOWN = 10.0  # log likelihood, that a side shows
LEAST_THERE = -40.0  # log likelihood, of a side that is not there at all, below that of no border
MISTAKEN = 12.0  # log likelihood: so unlikely is it that a foot, a mouth or a border was taken for a side
OWN_STD = 4e-6  # m, of a width in another look: what the two do not share
LIFTS: Array = np.arange(-8e-3, 16.05e-3, 0.1e-3)
WIDTHS: Array = np.linspace(-3.5, 3.5, 21)  # standard deviations
PLAYS: Array = np.linspace(-4.0, 4.0, 81)
FREE_PLAY = 1.5e-3  # m, that a top is looked for aside of its place
PAIRS = ((3, 1), (0, 2))  # sides that are opposite, along x and y
BEYOND = 5.0  # log likelihood below the least one, of a place that was not looked at


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
    if top.twist > MOST_TWIST:
        return Seating(
            "unsure", "the sides of its top are not those of a square: it leans, or something is across it"
        )
    if (top.shown < LEAST_THERE).any():
        return Seating("unsure", "what is seen there is not the top of a cube that stands upright")
    seen = int((top.shown > LEAST_SHOWN).sum())
    if not _shows(top):
        return Seating("unsure", "the sides of its top do not show well enough")
    width = CubeWidth(cube.value, float(np.hypot(cube.std, OWN_STD)))
    log, best = _heights(top, width, PLAY * PLAYS)
    lift, std = _moments(LIFTS, log)
    if best < -MOST_UNLIKELY or (best < -ALL_AGREE and seen < len(top.shown)):
        aside = _aside(top, width)
        if aside > MOST_ASIDE:
            return Seating(
                "off", f"its top is {1e3 * aside:.1f} mm aside of where a seated one's is", lift, std
            )
        return Seating(
            "unsure", "the sides of its top are not where those of a seated or a higher cube are", lift, std
        )
    told = f"its top is {1e3 * lift:+.1f} mm from a seated one's height, std {1e3 * std:.1f} mm"
    known = std <= MOST_STD[seen] and -max(MOST_LIFT, SURE * std) <= lift <= MOST_LIFT
    if known and lift + SURE * std <= (LIFT if seen == len(top.shown) else LEANING):
        return Seating("seated", "", lift, std)
    return Seating("off" if abs(lift) - SURE * std > 0.0 else "unsure", told, lift, std)


def width_of(top: CubeTop | None, cube: CubeWidth) -> CubeWidth | None:
    """How wide a cube that sits is, by its top and by what is known of it; None where the top does not tell."""
    if top is None or abs(top.turn) > MOST_TURN or top.twist > MOST_TWIST or not _shows(top):
        return None
    log, best = _at_heights(top, cube, PLAY * PLAYS, np.zeros(1))
    if best < -MOST_UNLIKELY:
        return None
    return CubeWidth(*_moments(cube.value + cube.std * WIDTHS, log[0]))


def _shows(top: CubeTop) -> bool:
    """Whether at least one side shows along x and along y."""
    return all(max(top.shown[low], top.shown[high]) > LEAST_SHOWN for low, high in PAIRS)


def _heights(top: CubeTop, cube: CubeWidth, plays: Array) -> tuple[Array, float]:
    """Log likelihood of each of `LIFTS`, and of the best cube of any height, below that of free sides."""
    log, best = _at_heights(top, cube, plays, LIFTS)
    most = log.max(axis=1, keepdims=True)
    return most[:, 0] + np.log(np.exp(log - most).sum(axis=1)), best


def _at_heights(top: CubeTop, cube: CubeWidth, plays: Array, lifts: Array) -> tuple[Array, float]:
    """Log likelihood of heights and widths, (lifts, widths), play integrated out; and the best of all three.

    A top that is higher is seen wider, and farther from the camera's foot. A wider cube sits higher, too: `top.rise`.
    """
    widths = cube.value + cube.std * WIDTHS
    height = lifts[:, None] + top.rise * (widths - top.size)
    larger = top.distance / (top.distance - height)  # as a top is seen, on the plane of a seated one's
    half = (widths * larger - top.size) / 2.0
    log = np.broadcast_to(-0.5 * WIDTHS**2, half.shape)
    best, sides = log, _likely(top)
    for axis, (low, high) in enumerate(PAIRS):
        shift = -top.slope[axis] * top.distance * (larger - 1.0)
        aside = shift[..., None] + larger[..., None] * plays
        one = -0.5 * (plays / PLAY) ** 2 if plays[-1] < FREE_PLAY else np.zeros(len(plays))
        one = one + _at(sides[high], half[..., None] + aside) + _at(sides[low], half[..., None] - aside)
        most = one.max(axis=-1)
        best = best + most
        log = log + most + np.log(np.exp(one - most[..., None]).mean(axis=-1))
    return log, float(best.max())


def _likely(top: CubeTop) -> list[Array]:
    """Log likelihood of each side at `PLACES`: that it is seen there, or that something else was taken for it.

    One such side is outvoted by the other three; two of them are not a cube's top.
    """
    return [
        np.logaddexp(side, -min(max(shown, 0.0), MISTAKEN))
        for side, shown in zip(top.sides, top.shown, strict=True)
    ]


def _at(side: Array, places: Array) -> Array:
    beyond = float(side.min()) - BEYOND
    return np.asarray(np.interp(places, PLACES, side, left=beyond, right=beyond))


def _aside(top: CubeTop, cube: CubeWidth) -> float:
    """How far aside the middle of a seated cube's top would be to fit best, m; 0 where none fits."""
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
    """Mean and standard deviation of values by their log likelihood."""
    weights = np.exp(log - log.max())
    weights /= weights.sum()
    mean = float(weights @ values)
    return mean, float(np.sqrt(weights @ (values - mean) ** 2))


@dataclass(frozen=True, eq=False)
class Sight:
    """Photographs of one moment, to measure cubes in.

    Attributes:
        images, camera: the photographs, and what took them.
        cube: a cube by its nominal width and what that may be off.
        pocket: width of a pocket's mouth and of its floor, m.
    """

    images: Sequence[Image]
    camera: Camera
    cube: CubeWidth
    pocket: tuple[float, float] = (POCKET_MOUTH, POCKET_FLOOR)

    def in_hole(self, T_base_hole: Array, empty: EmptyPlace | None = None) -> CubeTop | None:
        """The top of a cube in a hole, looked for where a seated one's is; `empty` is the hole without it."""
        size, (mouth, floor) = self.cube.value, self.pocket
        rise = 1.0 + POCKET_DEPTH / (mouth - floor)
        return measure_top(
            self.images,
            self.camera,
            T_base_hole,
            size,
            size - seat_depth(size, self.pocket),
            mouth,
            rise,
            empty,
        )

    def on_plane(self, T_base_place: Array, empty: EmptyPlace | None = None) -> CubeTop | None:
        """The top of a cube that stands on a plane, at a place and turned like it."""
        size = self.cube.value
        return measure_top(self.images, self.camera, T_base_place, size, size, None, 1.0, empty)

    def empty(self, T_base_place: Array) -> EmptyPlace:
        """A place that these photographs show empty."""
        return EmptyPlace(self.images, self.camera, T_base_place)

    def shows(self, points: Array) -> bool:
        """Whether points (n, 3) m of the base frame are in the image."""
        pixels = self.camera.project_base(points)
        with np.errstate(invalid="ignore"):
            return bool(((pixels > 0.0) & (pixels < np.array(self.camera.size) - 1.0)).all())

    def known_width(self, top: CubeTop | None) -> CubeWidth:
        """A cube's width for a later look: by its top, if that tells it, and by its nominal one."""
        return width_of(top, self.cube) or self.cube
