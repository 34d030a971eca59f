"""Features of the static background: scratches, specks and edges, each kept as a small patch of the image.

They are chosen once, with the camera's calibration, and found again in later images (`vision.background.tracking`).
Images are band-passed first, because shadows and changes of the light are smooth and would move features with them.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from arm.errors import ImpossibleError, InputError
from arm.io.storage import read_bytes, write_atomic
from arm.se3 import Array
from vision.camera.frame_source import Image, as_grey
from vision.camera.model import Camera

Floats = npt.NDArray[np.float32]

HALF = 10  # px; a patch has 2 HALF + 1 rows and columns
EDGE = HALF + 10  # px; no feature is nearer to the image's edge: converters and lenses spoil it
FINE_PX, COARSE_PX = 0.8, 6.0  # standard deviations of the band-pass: noise below, light and shadows above
MOST = 300  # features
APART = 14.0  # px, between features
CELLS = (8, 5)  # of the image: features are spread over them
POOREST = 0.1  # px; largest standard deviation that the image's noise may cause in a feature's position
FLAT = 2.0  # times the strength of noise, which a feature exceeds
FEWEST = 24  # features of a usable background
_FORMAT = 1
_SIDE = 2 * HALF + 1
_LARGEST = 1_000_000  # bytes of an array in a file; `MOST` patches have 265,000
_MEMBERS: dict[str, tuple[str, tuple[int | None, ...]]] = {
    "format": ("iu", ()),
    "points_px": ("f", (None, 2)),
    "patches": ("f", (None, _SIDE, _SIDE)),
    "size_px": ("iu", (2,)),
    "camera": ("U", ()),
}
"""Kinds of numpy types and shapes of the arrays in a file."""


@dataclass(frozen=True, eq=False)
class Background:
    """Features of the background, as seen by the camera at its calibration.

    Attributes:
        points: (n, 2) px.
        patches: (n, 2 HALF + 1, 2 HALF + 1) band-passed grey levels about the points.
        size: of the image, width and height, px.
        camera: digest of the calibrated camera, intrinsics and extrinsics, whose pose the features stand for.
    """

    points: Array
    patches: Floats
    size: tuple[int, int]
    camera: str


def band_passed(image: Image) -> Floats:
    """Return an image without its smooth parts and part of its noise, (h, w)."""
    floats = as_grey(image).astype(np.float32)
    fine = cv2.GaussianBlur(floats, (0, 0), FINE_PX)
    return np.asarray(fine - cv2.GaussianBlur(floats, (0, 0), COARSE_PX), dtype=np.float32)


def patch_at(image: Floats, point: npt.ArrayLike, half: int = HALF) -> Floats:
    """Return the (2 half + 1) square about a point, interpolated; the image's edge is repeated beyond it."""
    x, y = np.asarray(point, dtype=float)
    return np.asarray(cv2.getRectSubPix(image, (2 * half + 1, 2 * half + 1), (float(x), float(y))))


def background_features(
    images: Sequence[Image], camera: Camera, covered: Sequence[npt.ArrayLike] = ()
) -> Background:
    """Choose features of the background.

    Args:
        images: of the scene at rest; their mean is used. Only several tell noise from a table's fine texture: the
            features of one image may be noise, which later images do not have.
        camera: that took them.
        covered: polygons (m, 2) px of what may move, such as boards; no feature is taken in them.

    Raises:
        InputError: no image, or one of another size than the camera's.
        ImpossibleError: fewer than `FEWEST` features are found.
    """
    if not images:
        raise InputError("the background needs at least one image", count=0)
    for number, image in enumerate(images, start=1):
        camera.require_size(image, f"image {number} of {len(images)}")
    passed = [band_passed(image) for image in images]
    mean = _mean(passed)
    points = _chosen(mean, _noise_strength(passed), _usable(camera.size, covered))
    if len(points) < FEWEST:
        raise ImpossibleError(
            f"the background shows {len(points)} features, at least {FEWEST} are needed: clear the table, or stick "
            "some printed dots to it that stay there",
            features=len(points),
            least=FEWEST,
        )
    patches = np.stack([patch_at(mean, point) for point in points])
    return Background(points, patches, camera.size, camera.digest)


def _usable(size: tuple[int, int], covered: Sequence[npt.ArrayLike]) -> npt.NDArray[np.uint8]:
    width, height = size
    usable = np.zeros((height, width), np.uint8)
    usable[EDGE : height - EDGE, EDGE : width - EDGE] = 1
    for polygon in covered:
        outline = np.asarray(polygon, dtype=float).reshape(-1, 2)
        if np.isfinite(outline).all():
            cv2.fillConvexPoly(usable, cv2.convexHull(np.rint(outline).astype(np.int32)), 0)
    cv2.erode(usable, np.ones((_SIDE, _SIDE), np.uint8), dst=usable)
    return usable


def _strength(passed: Floats) -> Floats:
    """Return how well each place of an image is localised in its worst direction, (h, w) grey levels^2 / px^2."""
    gy, gx = (np.asarray(g, dtype=np.float32) for g in np.gradient(passed))
    sums = [cv2.boxFilter(g, -1, (_SIDE, _SIDE), normalize=False) for g in (gx * gx, gx * gy, gy * gy)]
    half_trace, half_difference = (sums[0] + sums[2]) / 2.0, (sums[0] - sums[2]) / 2.0
    return np.asarray(half_trace - np.sqrt(half_difference**2 + sums[1] ** 2), dtype=np.float32)


def _mean(images: Sequence[Floats]) -> Floats:
    return np.asarray(np.mean(images, axis=0), dtype=np.float32)


def _noise_strength(passed: Sequence[Floats]) -> tuple[float, float]:
    """Return the mean image's noise, grey levels, and the strength that it causes; 0 if there is only one image."""
    if len(passed) == 1:
        return float(np.median(np.abs(passed[0])) / 0.6745), 0.0
    half = len(passed) // 2
    halves = [_mean(part) for part in (passed[:half], passed[half : 2 * half])]
    noise = np.asarray((halves[0] - halves[1]) / 2.0, dtype=np.float32)
    return float(np.median(np.abs(noise)) / 0.6745), float(np.median(_strength(noise)))


def _chosen(passed: Floats, noise: tuple[float, float], usable: npt.NDArray[np.uint8]) -> Array:
    """Return the best-localised points, spread over the image, (n, 2) px."""
    weakest = _strength(passed)
    least = (max(noise[0], 0.1) / POOREST) ** 2 + FLAT * noise[1]
    peaks = (weakest == cv2.dilate(weakest, np.ones((_SIDE, _SIDE)))) & (weakest > least) & (usable > 0)
    rows, columns = np.nonzero(peaks)
    order = np.argsort(-weakest[rows, columns], kind="stable")
    height, width = passed.shape
    share = -(-2 * MOST // (CELLS[0] * CELLS[1]))  # twice an even share
    counts = np.zeros(CELLS, dtype=int)
    chosen: list[tuple[int, int]] = []
    for x, y in zip(columns[order], rows[order], strict=True):
        cell = x * CELLS[0] // width, y * CELLS[1] // height
        near = any((x - u) ** 2 + (y - v) ** 2 < APART**2 for u, v in chosen)
        if counts[cell] < share and not near:
            counts[cell] += 1
            chosen.append((x, y))
        if len(chosen) == MOST:
            break
    return np.array(chosen, dtype=float).reshape(-1, 2)


def write_background(file: Path, background: Background) -> None:
    """Write a background whole or not at all; the same background gives the same bytes.

    Raises:
        InputError: it cannot be written.
    """
    data = io.BytesIO()
    np.savez_compressed(
        data,
        format=np.array(_FORMAT),
        points_px=background.points,
        patches=background.patches.astype(np.float16),
        size_px=np.array(background.size),
        camera=np.array(background.camera),
    )
    write_atomic(file, data.getvalue())


def read_background(file: Path, camera: Camera) -> Background:
    """Read a background that was taken for a calibrated camera.

    Raises:
        InputError: it cannot be read, is none, or was taken for another calibration.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(read_bytes(file, "background"))) as archive:
            read = {key: _member(archive, key, *of) for key, of in _MEMBERS.items()}
    # what zipfile raises for damaged, encrypted and unknown data
    except (ValueError, KeyError, EOFError, OSError, RuntimeError, zlib.error, zipfile.BadZipFile) as error:
        if isinstance(error, zipfile.BadZipFile):
            why = f"{file}: is no background; a465 calibrate background writes one, to a file .npz"
            raise InputError(why, file=str(file)) from error
        raise InputError(f"{file}: is no background that a465 wrote ({error})", file=str(file)) from error
    if int(read["format"]) != _FORMAT:
        raise InputError(
            f"{file}: format is {int(read['format'])}, must be {_FORMAT}: take a new background",
            file=str(file),
        )
    size, digest = (int(read["size_px"][0]), int(read["size_px"][1])), str(read["camera"])
    if (size, digest) != (camera.size, camera.digest):
        raise InputError(
            f"{file}: was taken for another calibration of the camera (lens, pose or image size); take it again with "
            "`a465 calibrate background`",
            file=str(file),
        )
    points, patches = read["points_px"].astype(float), read["patches"].astype(np.float32)
    if (broken := _broken(points, patches, size)) is not None:
        raise InputError(f"{file}: {broken}; take a new background", file=str(file))
    return Background(points, patches, size, digest)


def _member(
    archive: zipfile.ZipFile, key: str, kinds: str, shape: tuple[int | None, ...]
) -> npt.NDArray[Any]:
    """Read one array of a background, after its length, type and shape were checked.

    Raises:
        ValueError: it is not as `write_background` writes it.
    """
    with archive.open(f"{key}.npy") as member:
        data = io.BytesIO(member.read(_LARGEST + 1))
    if len(data.getvalue()) > _LARGEST:
        raise ValueError(f"{key} has more than {_LARGEST} bytes")
    version = np.lib.format.read_magic(data)
    if version != (1, 0):
        raise ValueError(f"{key} is written in version {version} of numpy's format, must be (1, 0)")
    there, _, dtype = np.lib.format.read_array_header_1_0(data)
    fits = len(there) == len(shape) and all(
        n >= 0 and w in (None, n) for n, w in zip(there, shape, strict=True)
    )
    if not fits or dtype.kind not in kinds or dtype.itemsize * int(np.prod(there, dtype=object)) > _LARGEST:
        raise ValueError(f"{key} is an array {there} of {dtype}")
    data.seek(0)
    return np.asarray(np.lib.format.read_array(data, allow_pickle=False))


def _broken(points: Array, patches: Floats, size: tuple[int, int]) -> str | None:
    """Return which key of a background is not as `background_features` makes it, or None."""
    if len(points) != len(patches) or not FEWEST <= len(points) <= MOST:
        return f"points_px has {len(points)} and patches {len(patches)} features, must be {FEWEST} to {MOST} of both"
    within = (points >= 0.0) & (points < size)
    if not within.all() or len(np.unique(points, axis=0)) < len(points):
        return "points_px must be different places in the image"
    if not (np.abs(patches) <= 255.0).all() or (np.ptp(patches, axis=(1, 2)) == 0.0).any():
        return "patches must have grey levels from -255 to 255, in none all the same"
    return None
