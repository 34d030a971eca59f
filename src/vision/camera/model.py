"""Camera model: maps points of the base frame to pixels; and the camera file.

Pixels follow OpenCV: the centre of the first pixel is (0, 0), x to the right, y down. The camera frame has z along the
optical axis, x to the right of the image and y down.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.former import former_names
from arm.io.keys import Keys, key
from arm.io.node import Node, Rule
from arm.io.rules import covariance_matrix, integers, number, numbers, rigid, table, tables
from arm.io.storage import sha256, write_atomic
from arm.io.toml_writer import toml_lines, toml_rows
from arm.se3 import Array, apply, frozen, inverse
from vision.camera.distortion import distort, distortion_jacobian, undistort
from vision.camera.frame_source import FrameSource, Image, ImageFolder
from vision.camera.taped_pose import looking_pose

__all__ = ["Camera", "FrameSource", "Image", "ImageFolder", "read_camera", "read_intrinsics", "write_camera"]


Region = tuple[float, float, float, float]
"""Part of an image: left, top, right, bottom, px."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera.

    Attributes:
        K: camera matrix (3, 3), px.
        distortion: k1 k2 p1 p2 k3 (5,), see `vision.camera.distortion`.
        size: width and height of its images, px.
        T_base_camera: extrinsics, 4x4.
        calibration: origin of the values, from the camera file (id, date, ...); not in the digest.
        lens_covariance: of fx fy cx cy k1 k2 p1 p2 k3, (9, 9), or None if unknown; not in the digest.
        region: part of the image for which the lens was calibrated, or None for all of it; not in the digest.
    """

    K: Array
    distortion: Array
    size: tuple[int, int]
    T_base_camera: Array
    calibration: Mapping[str, Any] = field(default_factory=dict)
    lens_covariance: Array | None = None
    region: Region | None = None

    def __post_init__(self) -> None:
        for name in ("K", "distortion", "T_base_camera", "lens_covariance"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of intrinsics and extrinsics."""
        return sha256(
            {
                "K_px": self.K.tolist(),
                "distortion": self.distortion.tolist(),
                "size_px": list(self.size),
                "T_base_camera": self.T_base_camera.tolist(),
            }
        )

    @cached_property
    def lens_digest(self) -> str:
        """SHA-256 of the intrinsics, independent of the extrinsics."""
        return self.at(np.eye(4)).digest

    @cached_property
    def T_camera_base(self) -> Array:
        """Inverse of `T_base_camera`."""
        return inverse(self.T_base_camera)

    def at(self, T_base_camera: Array) -> Camera:
        """The same camera with other extrinsics (4x4)."""
        return replace(self, T_base_camera=T_base_camera)

    def project(self, points_camera: npt.ArrayLike) -> Array:
        """Project points (..., 3) m in the camera frame to pixels (..., 2); NaN for points that are not in front."""
        points = np.asarray(points_camera, dtype=float)
        z = np.where(points[..., 2] > 0.0, points[..., 2], np.nan)
        distorted = distort(self.distortion, points[..., :2] / z[..., None])
        return np.asarray(distorted @ self.K[:2, :2].T + self.K[:2, 2])

    def project_base(self, points_base: npt.ArrayLike) -> Array:
        """Project points (..., 3) m in the base frame to pixels (..., 2)."""
        return self.project(apply(self.T_camera_base, points_base))

    def projection_jacobian(self, points_camera: npt.ArrayLike) -> Array:
        """Derivative of `project` by the points: (..., 3) m to (..., 2, 3) px/m."""
        points = np.asarray(points_camera, dtype=float)
        on_plane = points[..., :2] / points[..., 2:]
        pinhole = np.zeros((*points.shape[:-1], 2, 3))
        pinhole[..., 0, 0] = pinhole[..., 1, 1] = 1.0
        pinhole[..., 2] = -on_plane
        jacobian: Array = self.K[:2, :2] @ distortion_jacobian(self.distortion, on_plane) @ pinhole
        jacobian /= points[..., 2, None, None]
        return jacobian

    def intrinsics_jacobian(self, points_camera: Array) -> Array:
        """Derivative of `project` by fx fy cx cy k1 k2 p1 p2 k3, without skew: points (..., 3) m to (..., 2, 9)."""
        on_plane = points_camera[..., :2] / points_camera[..., 2:]
        x, y = on_plane[..., 0], on_plane[..., 1]
        r2 = x * x + y * y
        J = np.zeros((*x.shape, 2, 9))
        distorted = distort(self.distortion, on_plane)
        J[..., 0, 0], J[..., 1, 1] = distorted[..., 0], distorted[..., 1]
        J[..., 0, 2] = J[..., 1, 3] = 1.0
        for column, power in ((4, r2), (5, r2**2), (8, r2**3)):
            J[..., column] = on_plane * power[..., None]
        J[..., 0, 6], J[..., 1, 6] = 2.0 * x * y, r2 + 2.0 * y * y
        J[..., 0, 7], J[..., 1, 7] = r2 + 2.0 * x * x, 2.0 * x * y
        J[..., 4:] *= np.diag(self.K)[:2][:, None]
        return J

    def normalised(self, pixels: npt.ArrayLike) -> Array:
        """Map pixels (..., 2) to undistorted points (..., 2) on the plane z = 1 of the camera frame.

        NaN where the distortion has no inverse; `read_camera` excludes this inside the image.
        """
        (fx, skew, cx), (_, fy, cy) = self.K[0], self.K[1]
        pixels = np.asarray(pixels, dtype=float)
        y = (pixels[..., 1] - cy) / fy
        x = (pixels[..., 0] - cx - skew * y) / fx
        return undistort(self.distortion, np.stack([x, y], axis=-1))

    def rays(self, pixels: npt.ArrayLike) -> Array:
        """Directions (..., 3) of pixels (..., 2) in the camera frame, with z = 1; NaN as in `normalised`."""
        return np.insert(self.normalised(pixels), 2, 1.0, axis=-1)

    def require_size(self, image: Image, what: str) -> None:
        """Check that an image has this camera's size and a valid format.

        Raises:
            InputError: names the image (`what`) and both sizes.
        """
        if image.dtype != np.uint8 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
            why = f"{what}: is {image.dtype} of shape {image.shape}; images must be 8-bit grey (h, w) or BGR (h, w, 3)"
            raise InputError(why, image=what)
        height, width = image.shape[:2]
        if (width, height) != self.size:
            turned = (height, width) == self.size
            why = (
                f"{what}: is {width} x {height} px, but the camera's calibration is for "
                f"{self.size[0]} x {self.size[1]} px; "
            )
            why += _TURNED if turned else "use the full frame, or calibrate for this size"
            raise InputError(why, image=what, size_px=[width, height], camera_size_px=list(self.size))


def _intrinsic_matrix(node: Node) -> Array:
    K = numbers((3, 3), "px").read(node)
    if min(K[0, 0], K[1, 1]) <= 0.0 or K[1, 0] != 0.0 or not np.array_equal(K[2], (0.0, 0.0, 1.0)):
        is_transposed = not K[:2, 2].any() and K[2, :2].all()
        help = "is it transposed, as MATLAB has it?" if is_transposed else ""
        raise node.error("must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy above 0", help)
    return K


def _off_centre(point: Array, size: tuple[int, int]) -> float:
    """Return how far a pixel is from the middle of an image, at most along an axis, as a fraction of the size."""
    return float(np.abs(point / size - 0.5).max())


INTRINSIC_MATRIX = Rule(numbers((3, 3), "px").words, _intrinsic_matrix)


def _region(node: Node) -> Region:
    left, top, right, bottom = numbers(4, "px").read(node)
    if not (left < right and top < bottom):
        raise node.error("must be [left, top, right, bottom] in px, with left < right and top < bottom")
    return float(left), float(top), float(right), float(bottom)


REGION = Rule(numbers(4, "px").words, _region)

FARTHEST = 20.0  # m along each axis from the base to a camera; more is a pose in other units
_FARTHEST_MM = 1e3 * FARTHEST
_TURNED = "its sides are exchanged: was it turned by 90 deg? use it as the camera takes it"
_UPWARDS = 0.5  # sine of the angle above the horizon: so a camera above the table sees no board
LEAST_FOCAL = 0.25  # of the image's longer side: 127 deg, beyond which this model of a lens does not hold
_NEAREST = 0.05  # m from the base: a position by tape is outside the arm
# Principal point off the middle, of the size: more if width and height are swapped, less if not.
SWAPPED = (0.3, 0.2)


class CameraKeys(Keys, file="a camera file"):
    """Keys of a camera file."""

    size: tuple[int, ...] = key("intrinsics.size_px", integers(2, 16, 20000))
    K: Array = key("intrinsics.K_px", INTRINSIC_MATRIX)
    distortion: Array = key("intrinsics.distortion_k1k2p1p2k3", numbers(5))
    covariance: Array | None = key("intrinsics.covariance", covariance_matrix(9), None)
    region: Region | None = key("intrinsics.region_px", REGION, None)
    T_base_camera: Array | None = key("pose.T_base_camera", rigid(), None)
    position: Array | None = key("pose.position_mm", numbers(3, "mm", -_FARTHEST_MM, _FARTHEST_MM), None)
    looks_at: Array | None = key("pose.looks_at_mm", numbers(3, "mm", -_FARTHEST_MM, _FARTHEST_MM), None)
    right_azimuth: float | None = key("pose.right_azimuth_deg", number("deg", -360, 360), None)
    calibration: Mapping[str, Any] = key("calibration", table(), {})
    # poses of the target, for people and for later calibrations
    views: tuple[Any, ...] = key("views", tables(lambda node: node.value), default=[])


def read_camera(path: Path) -> Camera:
    """Read a camera file: ``[intrinsics]``, ``[pose]`` and, for information, ``[calibration]`` and ``[[views]]``.

    Raises:
        FileInputError: a value breaks its rule, the pose is no rigid transform, the distortion has no inverse somewhere
            in the image (as with coefficients in another order), or the file has no pose.
    """
    return _read(path, placed=True)


def read_intrinsics(path: Path) -> Camera:
    """Read the intrinsics of a camera file, with or without a ``[pose]``; the camera is at the origin.

    Raises:
        FileInputError: as for `read_camera`.
    """
    return _read(path, placed=False).at(np.eye(4))


def _read(path: Path, placed: bool) -> Camera:
    root = Node.of_toml(path, "camera")
    keys = CameraKeys.read(root)
    T_base_camera = _pose_of(root, keys, placed)
    away = float(np.abs(T_base_camera[:3, 3]).max())
    if away > FARTHEST:
        raise root.error_at(
            "pose.T_base_camera",
            f"puts the camera {away:g} m from the base along one axis; at most {FARTHEST:g} m are allowed",
            "its last column is in metres",
        )
    size = (keys.size[0], keys.size[1])
    require_px(root["intrinsics"], keys.K, size)
    camera = Camera(
        keys.K, keys.distortion, size, T_base_camera, keys.calibration, keys.covariance, keys.region
    )
    if not _has_inverse(camera):
        raise root.error_at(
            "intrinsics.distortion_k1k2p1p2k3",
            "has no inverse somewhere in the image",
            "the order is k1 k2 p1 p2 k3; calibration views must reach the image's corners",
        )
    return camera


_HALF = 0.35  # of width and height; a principal point nearer to the first pixel is of smaller images


def require_px(
    table: Node, K: Array, size: tuple[int, int], focal: str = "K_px", centre: str = "K_px"
) -> None:
    """Require a focal length and a principal point that can be in px, of images of this size.

    Args:
        table: of the intrinsics, with size_px.
        K: 3x3 pinhole of the table.
        size: width and height, px.
        focal, centre: its keys that have the focal length and the principal point.

    Raises:
        FileInputError: they are in another unit, or of images of another size.
    """
    middle = K[:2, 2]
    if _off_centre(middle, size) > SWAPPED[0] and _off_centre(middle, size[::-1]) < SWAPPED[1]:
        rule = f"must be width and height, with cx {middle[0]:g} and cy {middle[1]:g} near the middle"
        help = f"are they swapped? [{size[1]}, {size[0]}]; or cx and cy in {centre}"
        raise table.error_at("size_px", rule, help)
    (fx, fy), (cx, cy) = K.diagonal()[:2].tolist(), K[:2, 2].tolist()
    if min(fx, fy) < LEAST_FOCAL * max(size):
        wide = 2.0 * np.degrees(np.arctan2(max(size) / 2.0, min(fx, fy)))
        least = f"must have a focal length of {LEAST_FOCAL * max(size):g} px or more"
        rule = f"{least}; {min(fx, fy):g} px see {wide:.0f} deg"
        raise table.error_at(focal, rule, "is it in mm? divide it by the size of a pixel in mm")
    if not (0.0 < cx < size[0] and 0.0 < cy < size[1]):
        rule = f"must have its principal point cx, cy inside the image, {size[0]} x {size[1]} px; it is {cx:g}, {cy:g}"
        past = cx >= size[0] or cy >= size[1]
        help = (
            f"are size_px and {centre} of images of one size?"
            if past
            else "they count from the image's first pixel"
        )
        raise table.error_at(centre, rule, help)
    shares = np.array([cx, cy]) / size
    if shares.max() < _HALF and np.ptp(shares) < _HALF / 5.0:
        whole = " x ".join(f"{2.0 * c:.0f}" for c in (cx, cy))
        rule = f"must have its principal point cx, cy near the middle of {size[0]} x {size[1]} px; it is {cx:g}, {cy:g}"
        help = f"it is the middle of {whole} px: are size_px and {centre} of images of one size?"
        raise table.error_at(centre, rule, help)


def _pose_of(root: Node, keys: CameraKeys, placed: bool) -> Array:
    """The pose of a camera file, by its matrix or by what a tape measures."""
    taped = {
        "position_mm": keys.position,
        "looks_at_mm": keys.looks_at,
        "right_azimuth_deg": keys.right_azimuth,
    }
    stated = [name for name, value in taped.items() if value is not None]
    if keys.T_base_camera is not None:
        if stated:
            raise root.error_at(f"pose.{stated[0]}", "must be left out where T_base_camera is given")
        if keys.T_base_camera[2, 2] > _UPWARDS:
            up = float(np.degrees(np.arcsin(keys.T_base_camera[2, 2])))
            rule = f"looks {up:.0f} deg upwards, and boards are seen from above"
            help = "its third column is the line of sight; are its y and z those of OpenGL, which looks along -z?"
            raise root.error_at("pose.T_base_camera", rule, help)
        return keys.T_base_camera
    if "pose" not in root and not placed:
        return np.eye(4)
    if not stated:
        raise root.error_at(
            "pose.T_base_camera" if "pose" in root else "pose",
            "is missing: the file has intrinsics, but no extrinsics",
            "add [pose] with position_mm, looks_at_mm and right_azimuth_deg, or with T_base_camera",
        )
    missing = next((name for name, value in taped.items() if value is None), None)
    if keys.position is None or keys.looks_at is None or keys.right_azimuth is None:
        raise root.error_at(f"pose.{missing}", f"is missing; it belongs to {stated[0]}")
    if np.abs(keys.position).max() < _NEAREST:
        rule = f"must be {1e3 * _NEAREST:g} mm or more from the base along one axis"
        raise root.error_at(
            "pose.position_mm", rule, "inside the arm is no place for a lens; is it in metres?"
        )
    if keys.looks_at[2] > keys.position[2]:
        rule = f"must be no higher than the lens, {1e3 * keys.position[2]:g} mm: boards are seen from above"
        raise root.error_at("pose.looks_at_mm", rule, "are position_mm and looks_at_mm swapped?")
    try:
        return looking_pose(keys.position, keys.looks_at, keys.right_azimuth)
    except InputError as error:
        raise root.error_at("pose.looks_at_mm", f"gives no direction: {error}") from error


def _has_inverse(camera: Camera) -> bool:
    u, v = np.meshgrid(np.linspace(0.0, camera.size[0] - 1.0, 17), np.linspace(0.0, camera.size[1] - 1.0, 17))
    pixels = np.stack([u, v], axis=-1)
    return bool(np.abs(camera.project(camera.rays(pixels)) - pixels).max() < 1e-6)  # NaN compares false


def write_camera(
    path: Path, camera: Camera, placed: bool = True, views: Sequence[Mapping[str, Any]] = ()
) -> None:
    """Write a camera file that `read_camera` reads back bit by bit.

    Args:
        path: of the file.
        camera: values of `calibration` are texts, numbers, flags, dates, or lists of these.
        placed: whether to write the extrinsics; without them only `read_intrinsics` reads the file.
        views: of the target in the calibration, values as in `calibration`.

    Raises:
        InputError: the file cannot be written.
    """
    lines = [
        "[intrinsics]",
        f"size_px = {list(camera.size)}",
        f"K_px = {toml_rows(camera.K)}",
        f"distortion_k1k2p1p2k3 = {camera.distortion.tolist()}",
    ]
    if camera.lens_covariance is not None:
        lines += ["# of fx fy cx cy k1 k2 p1 p2 k3", f"covariance = {toml_rows(camera.lens_covariance)}"]
    if camera.region is not None:
        lines += [f"region_px = {list(camera.region)}"]
    if placed:
        lines += ["", "[pose]", f"T_base_camera = {toml_rows(camera.T_base_camera)}"]
    if camera.calibration:
        lines += ["", "[calibration]", *toml_lines(camera.calibration)]
    for view in views:
        lines += ["", "[[views]]", *toml_lines(view)]
    write_atomic(path, "\n".join(lines) + "\n")


former_names(__name__, __name__, read_lens="read_intrinsics")
