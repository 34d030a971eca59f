"""Locate a cube that is not properly seated, so that it can be gripped where it is.

Squares of the size of its top are candidates. The four sides of each are measured in the image, and a pose is fitted to
them for each way in which a cube can rest there. A pose is returned only if it is certain: the sides show along most of
their length, the top is even, the sides and the contacts agree, no other rest and no other candidate explains the image
nearly as well, and the pose is known accurately enough to grip the cube. Otherwise the reason is returned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.board import seat_depth
from arm.se3 import Array, apply, frozen, inverse, rotation_vector, transform
from vision.camera.frame_source import Image
from vision.camera.model import Camera
from vision.loose.candidates import candidates
from vision.loose.fit import PoseFit, fit_pose, pose_of, turned_to, with_yaw_near
from vision.loose.rests import LIFT, Rest, possible, rests, usual_normal
from vision.loose.sides import Sides, measure_sides
from vision.occupancy.cube_top import EmptyPlace
from vision.occupancy.edge_response import PlateView, plate_view
from vision.occupancy.seated import CubeWidth

REACHES_PX = (11.0, 6.0, 3.5)  # of the search for sides, as the pose becomes more accurate
STRAY = 8e-3  # m: a leaning cube's top is farther from the place than its centre
LEAST_SHOWN = 0.6  # fraction of each of three sides,
LEAST_LAST = 0.25  # of the least visible one,
LEAST_ALL = 0.7  # and of all four
MARGIN, PATCH = 2e-3, 1e-3  # m from the sides of a top that is not compared, and between points of the rest
BESIDE = 2.5e-3  # m beyond the sides, where the step to what is beside the top is measured
UNEVEN = 0.25  # of this step: a point that differs by more from a smooth top
MOST_UNEVEN = 0.03  # fraction of such points
MOST_RMS_PX = 0.35  # of steps about their lines
MOST_MISFIT = 18.0  # of 8 degrees of freedom
MOST_WEDGED_MISFIT = 9.0  # of a wedged cube, whose tilt follows from its place; real ones misfit by 1 to 4
MOST_COARSE_MISFIT = (
    9.0  # of an upright cube to the lines of its sides alone; the one that needs it misfits by 6
)
MOST_GAIN = 25.0  # of misfit by a free pose
RIVAL = 10.0  # difference of evidence, -2 log, within which another rest is possible
MOST_STD = (0.35e-3, 0.7e-3, np.radians(1.3))  # across the normal, along it, any angle
# the same of an upright cube: fingers hold its sides at any height, and the pocket that it is in captures it again
MOST_UPRIGHT_STD = (0.5e-3, 1.2e-3, np.radians(1.3))
ALIKE = (0.8e-3, np.radians(2.0))  # two poses that differ less are the same for a gripper
SAME_PLACE = 12e-3  # m: the centre of a known cube
SAME_CUBE = 2e-3  # m: two candidates that are the same cube
OVERLAP = 1.5e-3  # m that two measured cubes may overlap
CHANGED = 6.0  # smallest change of the top from the empty place, standard deviations of the noise
LEAST_CHANGE = 4.0  # the same, grey levels


@dataclass(frozen=True, eq=False)
class LooseCube:
    """A cube that was located.

    Attributes:
        T_base_cube: pose of its centre, 4x4; z is the outward normal of its top, the yaw (modulo 90 degrees) is that
            nearest to the place's.
        covariance: of the twist (translation m, rotation rad) in the cube's frame, (6, 6), see `arm.poses`. It includes
            the images, the cube's width and the contacts, not the camera's or the place's errors beyond these.
        residual_px: root mean square distance of the steps of grey from the lines of the top's sides.
    """

    T_base_cube: Array
    covariance: Array
    residual_px: float


@dataclass(frozen=True)
class NotLocated:
    """Why no cube was located."""

    reason: str


@dataclass(frozen=True, eq=False)
class _Place:
    """What is known of a place; see `locate_cube`.

    Attributes:
        view: the image, and its noise in grey levels.
        mouth_px: corners of the pocket's mouth, (4, 2) px, or None.
    """

    view: PlateView
    noise: float
    T_base_place: Array
    width: CubeWidth
    within: float
    pocket: tuple[float, float] | None
    mouth_px: Array | None
    others: Sequence[Array]
    empty: EmptyPlace | None


@dataclass(frozen=True, eq=False)
class _Found:
    """The accepted rests of a candidate, best first, and its sides."""

    fits: list[PoseFit]
    sides: Sides

    @property
    def centre(self) -> Array:
        """Centre of the cube by the best rest, (3,) m."""
        return self.fits[0].T_base_cube[:3, 3]


def locate_cube(
    images: Sequence[Image],
    camera: Camera,
    T_base_place: Array,
    width: CubeWidth,
    within: float,
    pocket: tuple[float, float] | None,
    others: Sequence[Array] = (),
    empty: EmptyPlace | None = None,
) -> LooseCube | NotLocated:
    """Locate a cube near a hole or a place on the table.

    Args:
        images: taken at one moment.
        camera: camera that took them.
        T_base_place: pose of the hole (z out of the plate, origin on its top) or of the place, 4x4.
        width: width of the cube.
        within: largest distance of the cube's centre from the place, along its plane, m.
        pocket: widths of the hole's mouth and floor, m; None if the place has no hole.
        others: poses of cubes that are known to be there, 4x4 each.
        empty: the place while no cube was there.
    """
    size = width.value
    # of the centre; a cube in its pocket may be 8 mm lower than one on the plane
    height = size / 2.0 - (0.0 if pocket is None else seat_depth(size, pocket) / 2.0)
    T_base_top = T_base_place @ transform(t=(0.0, 0.0, height + size / 2.0))
    view = plate_view(images, camera, T_base_top, within + STRAY + 1.2 * size)
    if view is None:
        return NotLocated("the place is outside the image")
    mouth_px = None
    if pocket is not None:
        corners = 0.5 * pocket[0] * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        mouth_px = camera.project_base(apply(T_base_place, corners))
    place = _Place(view, view.noise(), T_base_place, width, within, pocket, mouth_px, others, empty)
    found: list[_Found] = []
    reasons: list[str] = []
    for one in candidates(view, size, within + STRAY):
        T = pose_of(one.x, one.y, one.yaw, height, T_base_place)
        known = [other[:3, 3] for other in others] + [other.centre for other in found]
        if any(np.linalg.norm(T[:3, 3] - centre) < SAME_PLACE for centre in known):
            continue
        result = _judged(place, T)
        if isinstance(result, str):
            reasons.append(result)
        elif all(np.linalg.norm(result.centre - other.centre) > SAME_CUBE for other in found):
            found.append(result)
    if not found:
        return NotLocated(reasons[0] if reasons else "no square of a cube's size shows")
    if len(found) > 1:
        return NotLocated("two cubes, or something like a cube beside it")
    return _decided(found[0], T_base_place)


def _tracked(place: _Place, T_base_cube: Array) -> tuple[Sides, PoseFit] | str:
    """Measure the sides of a candidate and fit a free pose, ever more exactly; or why it is not possible."""
    found: tuple[Sides, PoseFit] | str = "the sides of its top do not show"
    for reach in REACHES_PX:
        exact = reach == REACHES_PX[-1]
        sides = measure_sides(
            place.view, T_base_cube, place.width.value, reach, place.noise, exact, place.mouth_px
        )
        if (sides.shown > LEAST_LAST).sum() < 3:
            return "the sides of its top do not show"
        fit = fit_pose(
            place.view, sides, Rest("free"), T_base_cube, place.T_base_place, place.width, place.pocket
        )
        if fit is None:
            return "the sides of its top do not determine its pose"
        found, T_base_cube = (sides, fit), fit.T_base_cube
    return found


def _judged(place: _Place, T_base_cube: Array) -> _Found | str:
    """Measure a candidate and fit all rests to it; or why it is no cube."""
    width, T_base_place = place.width, place.T_base_place
    tracked = _tracked(place, T_base_cube)
    if isinstance(tracked, str):
        return tracked
    sides, free = tracked
    why = _why_no_top(place, sides, free)
    if why:
        return why
    T_base_cube = free.T_base_cube
    if np.linalg.norm(apply(inverse(T_base_place), T_base_cube[:3, 3])[:2]) > place.within:
        return f"it is more than {1e3 * place.within:.0f} mm from the place"
    fits = []
    for rest in rests(place.pocket):
        # tilts of opposite sign look almost alike: each rest starts at its own
        start = turned_to(T_base_cube, T_base_place[:3, :3] @ usual_normal(rest), width.value)
        fit = fit_pose(place.view, sides, rest, start, T_base_place, width, place.pocket)
        most = MOST_WEDGED_MISFIT if rest.kind == "wedged" else MOST_MISFIT
        if fit is not None and fit.misfit <= min(most, free.misfit + MOST_GAIN):
            T_place_cube = inverse(T_base_place) @ fit.T_base_cube
            fits += [fit] if possible(rest, T_place_cube, width.value, place.pocket) else []
    if not fits and (coarse := _coarsely_upright(place)) is not None:
        sides, fits = coarse[0], [coarse[1]]
    if not fits:
        return "its top does not fit any way in which a cube can rest there"
    fits.sort(key=lambda fit: fit.worth)
    if any(_overlap(fits[0].T_base_cube, other, width.value) for other in place.others):
        return "it would overlap another cube"
    return _Found(fits, sides)


def _coarsely_upright(place: _Place) -> tuple[Sides, PoseFit] | None:
    """Measure the sides of an upright cube in its pocket by their lines alone, and fit its pose; None without one.

    Beside a top there may be more than the one step that the exact place of a side allows for, such as a narrow bright
    face and then a dark gap. Then it is off by 0.5 px, and its square seems to hover above the pocket. The lines of the
    sides are known to only 0.15 px, but an upright cube's pose is known so well before that they suffice.
    """
    if place.pocket is None:
        return None
    size, rest = place.width.value, Rest("upright")
    T = pose_of(0.0, 0.0, 0.0, size / 2.0 - seat_depth(size, place.pocket) + LIFT[0], place.T_base_place)
    found: tuple[Sides, PoseFit] | None = None
    for reach in REACHES_PX[1:]:
        sides = measure_sides(place.view, T, size, reach, place.noise)
        if (sides.shown > LEAST_LAST).sum() < 3:
            return None
        fit = fit_pose(place.view, sides, rest, T, place.T_base_place, place.width, place.pocket)
        if fit is None:
            return None
        found, T = (sides, fit), fit.T_base_cube
    if found is None or found[1].misfit > MOST_COARSE_MISFIT or _why_no_top(place, *found):
        return None
    seen = possible(rest, inverse(place.T_base_place) @ T, size, place.pocket)
    return found if seen else None


def _why_no_top(place: _Place, sides: Sides, fit: PoseFit) -> str:
    """Why a measured square is no top of a cube; empty if it is one."""
    shown = np.sort(sides.shown)
    if shown[0] < LEAST_LAST or shown[1] < LEAST_SHOWN or shown.mean() < LEAST_ALL:
        return f"only {100.0 * shown.mean():.0f} % of the sides of its top show"
    if sides.rms > MOST_RMS_PX:
        return f"the sides of its top are not straight: {sides.rms:.2f} px rms"
    half = fit.width / 2.0
    T_base_top = fit.T_base_cube @ transform(t=(0.0, 0.0, half))
    plane = replace(place.view, T_base_plane=T_base_top)
    inner = np.arange(-half + MARGIN, half - MARGIN + 1e-4, PATCH)
    points = np.stack(np.meshgrid(inner, inner), axis=-1).reshape(-1, 2)
    grey = plane.at(points)
    if not np.isfinite(grey).all():
        return "its top is not completely in the image"
    level = np.median(grey)
    away = np.abs(grey - level)
    usual = away <= np.percentile(away, 90.0)
    basis = np.column_stack([np.ones(len(points)), points])
    even = basis @ np.linalg.lstsq(basis[usual], grey[usual], rcond=None)[0]
    outer = np.full_like(inner, half + BESIDE)
    beside = [np.stack(at, axis=-1) for s in (-1, 1) for at in ((inner, s * outer), (s * outer, inner))]
    step = float(np.nanmedian(np.abs(plane.at(np.concatenate(beside)) - level)))
    uneven = float((np.abs(grey - even) > max(UNEVEN * step, 5.0 * place.noise)).mean())
    if uneven > MOST_UNEVEN:
        return f"its top is not even: {100.0 * uneven:.0f} % differ"
    if place.empty is not None and not _changed(
        place, apply(T_base_top, np.pad(points, ((0, 0), (0, 1)))), grey
    ):
        return "the image shows the same as while the place was empty"
    return ""


def _changed(place: _Place, points: Array, grey: Array) -> bool:
    """Whether points (n, 3) m of a top have other grey levels, (n,), than in the images of the empty place.

    True if those images do not show them. The light may have changed between the images, by a factor.
    """
    empty = place.empty
    if empty is None:
        return True
    before = plate_view(
        empty.images, empty.camera, empty.T_base_place, place.within + 2.0 * place.width.value
    )
    if before is None:
        return True
    at = before.camera.project_base(points) - before.corner_px
    height, width = before.grey.shape
    inside = ((at >= 0.0) & (at <= (width - 1.0, height - 1.0))).all(axis=1)
    if inside.mean() < 0.5:
        return True
    column, row = np.rint(at[inside]).astype(int).T
    around = np.linspace(-place.within, place.within, 25)
    grid = np.stack(np.meshgrid(around, around), axis=-1)
    now = replace(place.view, T_base_plane=place.T_base_place).at(grid)
    light = float(np.nanmedian(now / np.maximum(before.at(grid), 1.0)))
    change = float(np.median(np.abs(grey[inside] - light * before.grey[row, column])))
    return change > max(CHANGED * place.noise, LEAST_CHANGE)


def _decided(found: _Found, T_base_place: Array) -> LooseCube | NotLocated:
    """The pose of a candidate, if its rest is certain and its pose accurate."""
    best = found.fits[0]
    for other in found.fits[1:]:
        if other.worth < best.worth + RIVAL and not _alike(best.T_base_cube, other.T_base_cube):
            return NotLocated(f"it may be {best.rest.kind} or {other.rest.kind}: both explain the image")
    across, along, angle = (
        float(np.sqrt(np.linalg.eigvalsh(part)[-1]))
        for part in (best.covariance[:2, :2], best.covariance[2:3, 2:3], best.covariance[3:, 3:])
    )
    most = MOST_UPRIGHT_STD if best.rest.kind == "upright" else MOST_STD
    if across > most[0] or along > most[1] or angle > most[2]:
        return NotLocated(
            f"its pose is too uncertain: {1e3 * across:.2f} mm across, {1e3 * along:.2f} mm along its normal, "
            f"{np.degrees(angle):.1f} deg, standard deviations"
        )
    T = with_yaw_near(best.T_base_cube, T_base_place)
    turn = np.kron(np.eye(2), T[:3, :3].T @ best.T_base_cube[:3, :3])
    return LooseCube(frozen(T), frozen(turn @ best.covariance @ turn.T), found.sides.rms)


def _alike(T_a: Array, T_b: Array) -> bool:
    """Whether two poses of a cube with nearby orientations are the same for a gripper."""
    apart = inverse(T_a) @ T_b
    return bool(
        np.linalg.norm(apart[:3, 3]) < ALIKE[0] and np.linalg.norm(rotation_vector(apart[:3, :3])) < ALIKE[1]
    )


def _overlap(T_a: Array, T_b: Array, size: float) -> bool:
    """Whether two cubes overlap by more than `OVERLAP`: no face's normal separates them."""
    half = size / 2.0
    for T, other in ((T_a, T_b), (T_b, T_a)):
        R = T[:3, :3].T @ other[:3, :3]
        centre = apply(inverse(T), other[:3, 3])
        if (np.abs(centre) - half * np.abs(R).sum(axis=1) - half > -OVERLAP).any():
            return False
    return True
