"""Rotation of the camera since its calibration, measured on the background; resample images to the calibrated pose.

A camera on a post sways: its image of a table that stands still shifts by up to some px from photograph to photograph.
Features of the background (`vision.background.features`) are found in a new image, and one small rotation of the
camera is fitted to their shifts, with a change of scale that a swaying camera does not have. A feature that
disagrees is left out: something stands there that did not. Images are then resampled as the camera would have taken
them from its calibrated pose, so all that follows uses that pose.

A shift alone cannot tell a rotation from a translation. Both look the same at the background's distance. Their
difference grows with the height above it; `twist_covariance` includes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from arm.errors import ImpossibleError
from arm.se3 import Array, frozen, rotation, skew
from vision.background.features import Background, band_passed, patch_at
from vision.background.tracking import Tracks, far_shift, track
from vision.camera.model import Camera, Image

FEWEST_SEEN = 12  # features that agree
LEAST_SHARE = 1.0 / 3.0  # of the features found
FLOOR_PX = 0.05  # of a feature's position: interpolation, and light that changed about it
GATE = 3.0  # standard deviations beyond which a feature disagrees
LARGEST_SCALE = 5e-4
"""Relative; a camera that sways keeps its scale to 2e-4 (docs/sources.md, "A camera that sways")."""
SURE = 4.0  # standard deviations from which a change is certain
NOTED = 1e-4  # m at the background; a larger shift is reported
UNRECOGNISED = "background"  # reason in the data of a refusal: the camera cannot be compared
_PAIRS, _SEED, _ROUGH_PX = 200, 0, 0.8  # consensus: trials, and px within which a feature agrees
_ROUNDS = 20
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class CameraShift:
    """Rotation of the camera since its calibration.

    Attributes:
        rotation: rotation vector (3,) rad in the camera's own frame: T_base_now = T_base_camera Exp(rotation).
        covariance: of it, (3, 3).
        scale, scale_sigma: relative change of the background's size in the image, and its standard deviation.
        seen: number of features that agree.
        found: number of features found.
        focal: mean focal length, px.
        distance: of the background along the optical axis, m.
        reach: distance of the image's corners from its centre, px.
    """

    rotation: Array
    covariance: Array
    scale: float
    scale_sigma: float
    seen: int
    found: int
    focal: float
    distance: float
    reach: float

    @property
    def move(self) -> float:
        """Shift of the background at the image's centre, plus that of its corners by the turn about the axis, m."""
        across = self.focal * float(np.hypot(*self.rotation[:2]))
        return (across + self.reach * abs(float(self.rotation[2]))) * self.distance / self.focal

    @property
    def move_sigma(self) -> float:
        """Standard deviation of a point of the background at the image's centre, m."""
        return self.distance * float(np.sqrt(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]))

    @property
    def is_certain(self) -> bool:
        """Whether the camera has certainly moved, by enough to be reported."""
        return self.move > max(NOTED, SURE * self.move_sigma)

    @property
    def twist_covariance(self) -> Array:
        """Covariance (6, 6) of the corrected pose, of the twist (m, rad) in the camera's frame.

        The share of the shift that is a translation is unknown, between none and all: second moment 1/3.
        """
        found = np.zeros((6, 6))
        found[3:, 3:] = self.covariance
        across = np.array([*self.rotation[:2], 0.0])
        v = np.concatenate([skew(across) @ (0.0, 0.0, self.distance), -across])
        return found + np.outer(v, v) / 3.0

    def describe(self) -> str:
        """Return how far it moved, in mm at the background and deg."""
        turn = np.degrees(float(np.linalg.norm(self.rotation)))
        return f"{1e3 * self.move:.2f} +- {1e3 * self.move_sigma:.3f} mm at the table ({turn:.3f} deg)"

    def to_json(self) -> dict[str, Any]:
        """Return it as JSON types."""
        return {
            "moved_mm": 1e3 * self.move,
            "moved_std_mm": 1e3 * self.move_sigma,
            "rotation_deg": np.degrees(self.rotation).tolist(),
            "scale": self.scale,
            "features": self.seen,
            "features_found": self.found,
        }

    def require_small(self, limit: float) -> None:
        """Require a shift of the kind and size that is corrected.

        Args:
            limit: largest `move`, m.

        Raises:
            ImpossibleError: it is larger, or the background's size changed.
        """
        cure = (
            "fasten it, then calibrate its pose again (`a465 calibrate hand-eye`) and take a new background"
        )
        data = {"moved_mm": 1e3 * self.move, "rotation_rad": self.rotation.tolist(), "scale": self.scale}
        if abs(self.scale) > max(LARGEST_SCALE, SURE * self.scale_sigma):
            raise ImpossibleError(
                f"the camera's distance or focal length changed since its calibration: the background's size changed "
                f"by {100 * self.scale:+.2f} %, as by {1e3 * abs(self.scale) * self.distance:.1f} mm of height; "
                f"{cure}",
                limit=LARGEST_SCALE,
                **data,
            )
        if self.move > limit:
            raise ImpossibleError(
                f"the camera moved by {self.describe()} since its calibration, at most {1e3 * limit:g} mm "
                f"(camera_moved_mm) is corrected; {cure}",
                limit_mm=1e3 * limit,
                **data,
            )


def measure_shift(background: Background, image: Image, camera: Camera, distance: float) -> CameraShift:
    """Measure how far the camera has turned since its background was taken.

    Args:
        background: taken with this lens.
        image: of now.
        camera: as calibrated.
        distance: of the background along the optical axis, m.

    Raises:
        ImpossibleError: too little of the background is recognised.
    """
    passed = band_passed(image)
    tracks = track(background, passed)
    fitted = _fitted(background, tracks, camera)
    if fitted is None and (guess := far_shift(background, passed)) is not None:
        tracks = track(background, passed, guess)
        fitted = _fitted(background, tracks, camera)
    if fitted is None:
        raise ImpossibleError(
            f"the background is not recognised: {len(tracks.index)} of its {len(background.points)} features are "
            f"found, and fewer than {FEWEST_SEEN} of them agree; the camera was moved far, or the table is covered or "
            "was cleaned: look at the picture, then take a new background with `a465 calibrate background`",
            reason=UNRECOGNISED,
            found=len(tracks.index),
            features=len(background.points),
        )
    unknowns, covariance, seen = fitted
    return CameraShift(
        rotation=frozen(unknowns[:3]),
        covariance=frozen(covariance[:3, :3]),
        scale=float(unknowns[3]),
        scale_sigma=float(np.sqrt(covariance[3, 3])),
        seen=seen,
        found=len(tracks.index),
        focal=float(np.sqrt(camera.K[0, 0] * camera.K[1, 1])),
        distance=distance,
        reach=float(np.hypot(*camera.size)) / 2.0,
    )


def mean_shift(shifts: Sequence[CameraShift]) -> CameraShift:
    """Return the mean shift of a look's images; its covariance is that of one image, as their features are the same."""
    return replace(
        shifts[0],
        rotation=frozen(np.mean([s.rotation for s in shifts], axis=0)),
        covariance=frozen(np.mean([s.covariance for s in shifts], axis=0)),
        scale=float(np.mean([s.scale for s in shifts])),
        scale_sigma=float(np.mean([s.scale_sigma for s in shifts])),
        seen=min(s.seen for s in shifts),
        found=min(s.found for s in shifts),
    )


def require_one_scene(background: Background, images: Sequence[Image], camera: Camera) -> None:
    """Require that each image shows the features that the others show, as a later look at that background would ask.

    One image alone has nothing to be compared with.

    Args:
        background: chosen in the mean of these images.
        images: all of the scene at rest.
        camera: that took them.

    Raises:
        ImpossibleError: in an image fewer than `FEWEST_SEEN` features of the others agree; data: image, found.
    """
    passed = [band_passed(image) for image in images]
    for number, image in enumerate(images, start=1):
        others = passed[: number - 1] + passed[number:]
        if not others:
            return
        mean = np.asarray(np.mean(others, axis=0), dtype=np.float32)
        patches = np.stack([patch_at(mean, point) for point in background.points])
        shown = np.ptp(patches, axis=(1, 2)) > 0.0
        of_others = replace(background, points=background.points[shown], patches=patches[shown])
        try:
            measure_shift(of_others, image, camera, 1.0)
        except ImpossibleError as error:
            raise ImpossibleError(
                f"the images do not show one scene at rest: image {number} of {len(images)} shows "
                f"{error.data['found']} of the {len(background.points)} features of the others, of which fewer than "
                f"{FEWEST_SEEN} agree; a background is taken from images of the cell at rest, all by its camera, "
                "which stands still: are these of something else, such as a calibration target?",
                image=number,
                found=error.data["found"],
            ) from error


def as_calibrated(image: Image, camera: Camera, shift: CameraShift) -> Image:
    """Return an image as the camera would have taken it from its calibrated pose, of the same size.

    The lens's distortion of so small a shift is left out: it is below 0.01 px within the correction's limit.
    """
    corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], dtype=float) * (np.array(camera.size) - 1)
    now = _project(camera, camera.rays(corners), shift.rotation)
    matrix = np.linalg.lstsq(np.concatenate([corners, np.ones((4, 1))], axis=1), now, rcond=None)[0].T
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(image, matrix, camera.size, flags=flags, borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


def _project(camera: Camera, rays: Array, turn: Array, scale: float = 0.0) -> Array:
    """Project rays of the calibrated camera after it turned and its image grew about the principal point, px."""
    centre = camera.K[:2, 2]
    return centre + (1.0 + scale) * (camera.project(rays @ rotation(turn)) - centre)


def _fitted(background: Background, tracks: Tracks, camera: Camera) -> tuple[Array, Array, int] | None:
    """Fit rotation and scale to tracks: unknowns (4,), covariance (4, 4), count that agree; None if too few do."""
    if len(tracks.index) < FEWEST_SEEN:
        return None
    points = background.points[tracks.index]
    rays, seen = camera.rays(points), points + tracks.shifts
    agree = _consensus(rays, seen, camera)
    weights = np.linalg.inv(tracks.covariances + FLOOR_PX**2 * np.eye(2))
    unknowns = np.zeros(4)
    for _ in range(_ROUNDS):
        count = int(agree.sum())
        if count < max(FEWEST_SEEN, LEAST_SHARE * len(points)):
            return None
        for _ in range(3):
            residual, J = _linearised(rays[agree], seen[agree], camera, unknowns)
            normal = np.einsum("nia,nij,njb->ab", J, weights[agree], J)
            unknowns = unknowns + np.linalg.solve(
                normal, np.einsum("nia,nij,nj->a", J, weights[agree], residual)
            )
        residual, _ = _linearised(rays, seen, camera, unknowns)
        squares = np.einsum("ni,nij,nj->n", residual, weights, residual)
        now = squares < GATE**2
        if np.array_equal(now, agree):
            excess = max(1.0, float(squares[agree].sum()) / (2 * count - 4))
            return unknowns, np.asarray(np.linalg.inv(normal) * excess, dtype=float), count
        agree = now
    return None  # features keep changing sides: no shift explains them


def _linearised(rays: Array, seen: Array, camera: Camera, unknowns: Array) -> tuple[Array, Array]:
    """Return residuals (n, 2) px, and derivatives (n, 2, 4) of the projection by rotation and scale."""
    predicted = _project(camera, rays, unknowns[:3], unknowns[3])
    steps = _STEP * np.eye(4)
    J = [(_project(camera, rays, (unknowns + s)[:3], (unknowns + s)[3]) - predicted) / _STEP for s in steps]
    return seen - predicted, np.stack(J, axis=-1)


def _consensus(rays: Array, seen: Array, camera: Camera) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which features agree with the rotation and scale that most agree with, each trial from two features."""
    shifts, J = _linearised(rays, seen, camera, np.zeros(4))
    rng = np.random.default_rng(_SEED)
    pairs = np.array([rng.choice(len(rays), 2, replace=False) for _ in range(_PAIRS)])
    A, b = J[pairs].reshape(_PAIRS, 4, 4), shifts[pairs].reshape(_PAIRS, 4, 1)
    solvable = np.abs(np.linalg.det(A)) > 0.0
    trials = np.linalg.solve(A[solvable], b[solvable])[..., 0]
    off = np.linalg.norm(shifts - np.einsum("nia,ta->tni", J, trials), axis=-1)
    agree = off < _ROUGH_PX
    return np.asarray(agree[int(np.argmax(agree.sum(axis=1)))])
