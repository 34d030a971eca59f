"""A calibrated camera as a value, its file, and where frames come from.

Pinhole with Brown's distortion k1 k2 p1 p2 k3 as OpenCV has it; the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from arm.errors import A465Error, InputError
from arm.files import canonical_json, sha256, write_atomic
from arm.se3 import Array, apply, frozen, inverse, orthonormalised
from arm.toml_table import TomlTable

Image = npt.NDArray[np.uint8]
_UNDISTORT_STEPS = 30
_UNDISTORT_DONE = 1e-13


@dataclass(frozen=True, eq=False)
class Camera:
    """Lens, sensor and place of a camera.

    Attributes:
        K: (3, 3) px.
        distortion: (5,) k1 k2 p1 p2 k3.
        size: width and height of its images, px.
        T_base_camera: 4x4; camera frame x right, y down, z forward.
        digest: SHA-256 of all of that; plans carry it.
    """

    K: Array
    distortion: Array
    size: tuple[int, int]
    T_base_camera: Array

    @property
    def digest(self) -> str:
        """SHA-256 of the calibration's values."""
        return sha256(_values(self))

    def project(self, points_camera: npt.ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) m in the camera frame, which lie in front of it."""
        points = np.asarray(points_camera, dtype=float)
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        dx, dy = self._distorted(x, y)
        K = self.K
        return np.stack([K[0, 0] * dx + K[0, 1] * dy + K[0, 2], K[1, 1] * dy + K[1, 2]], axis=-1)

    def project_base(self, points_base: npt.ArrayLike) -> Array:
        """Pixels (..., 2) of points (..., 3) m in the base frame."""
        return self.project(apply(inverse(self.T_base_camera), points_base))

    def normalised(self, pixels: npt.ArrayLike) -> Array:
        """Undistorted image points (..., 2) on the plane z = 1 of pixels (..., 2), by fixed-point iteration."""
        px = np.asarray(pixels, dtype=float)
        K = self.K
        y0 = (px[..., 1] - K[1, 2]) / K[1, 1]
        x0 = (px[..., 0] - K[0, 2] - K[0, 1] * y0) / K[0, 0]
        x, y = x0.copy(), y0.copy()
        for _ in range(_UNDISTORT_STEPS):
            dx, dy = self._distorted(x, y)
            step_x, step_y = x0 - dx, y0 - dy
            x, y = x + step_x, y + step_y
            if max(np.abs(step_x).max(initial=0.0), np.abs(step_y).max(initial=0.0)) < _UNDISTORT_DONE:
                break
        return np.stack([x, y], axis=-1)

    def at(self, T_base_camera: npt.ArrayLike) -> Camera:
        """The same camera at another place."""
        return replace(self, T_base_camera=frozen(T_base_camera))

    def require_image(self, image: Image, name: str) -> None:
        """Refuse an image of another size, for which the calibration says nothing.

        Raises:
            InputError: with both sizes.
        """
        height, width = image.shape[:2]
        if (width, height) != self.size:
            raise InputError(
                f"{name} is {width} x {height} px: must be {self.size[0]} x {self.size[1]}, the size the camera was "
                "calibrated for",
                name=name,
                size=[width, height],
                expected=list(self.size),
            )

    def _distorted(self, x: Array, y: Array) -> tuple[Array, Array]:
        k1, k2, p1, p2, k3 = self.distortion
        r2 = x * x + y * y
        radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return (
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        )


def _values(camera: Camera) -> dict[str, Any]:
    return {
        "K": camera.K.tolist(),
        "distortion": camera.distortion.tolist(),
        "size": list(camera.size),
        "T_base_camera": camera.T_base_camera.tolist(),
    }


def read_camera(path: Path) -> Camera:
    """Read a camera file.

    Raises:
        FileInputError: a value breaks a rule; a pose that is nearly rigid (printed digits) is made so.
    """
    root = TomlTable.read(path)
    lens, pose = root.table("intrinsics"), root.table("pose")
    width, height = lens.integers("size_px", 2, 16, 20000)
    K = lens.matrix("K_px", 3, 3, "px")
    if K[0, 0] <= 0 or K[1, 1] <= 0 or np.any(K[[1, 2, 2], [0, 0, 1]] != 0) or K[2, 2] != 1:
        raise lens.error("K_px", "must be [[fx, skew, cx], [0, fy, cy], [0, 0, 1]] with fx, fy above 0")
    if not (0 <= K[0, 2] <= width and 0 <= K[1, 2] <= height):
        raise lens.error("K_px", f"must have its centre inside the image of {width} x {height} px")
    distortion = lens.numbers("distortion_k1k2p1p2k3", 5, "", -1e3, 1e3)
    try:
        T_base_camera = orthonormalised(pose.matrix("T_base_camera", 4, 4, "m"))
    except A465Error as error:
        raise pose.error("T_base_camera", str(error)) from error
    lens.finish()
    pose.finish()
    root.table("calibration", required=False)
    root.finish()
    return Camera(K, distortion, (width, height), T_base_camera)


def write_camera(path: Path, camera: Camera) -> None:
    """Write a camera file whole or not at all; reading it gives the same camera."""
    lines = [
        "[intrinsics]",
        f"size_px = {list(camera.size)}",
        f"K_px = {canonical_json(camera.K.tolist())}",
        f"distortion_k1k2p1p2k3 = {canonical_json(camera.distortion.tolist())}",
        "",
        "[pose]",
        f"T_base_camera = {canonical_json(camera.T_base_camera.tolist())}",
        "",
    ]
    write_atomic(path, "\n".join(lines))


class FrameSource(Protocol):
    """Where photographs come from."""

    def grab(self, count: int) -> Sequence[Image]:
        """`count` fresh frames, (h, w) grey or (h, w, 3) BGR."""
        ...


class ImageFolder:
    """Photographs of a folder in the order of their names, from the beginning at every grab.

    Args:
        path: the folder, or one image file.

    Raises:
        InputError: it is not there or holds no PNG, JPEG, BMP or TIFF.
    """

    SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")

    def __init__(self, path: Path) -> None:
        if path.is_file():
            self._files = [path]
        elif path.is_dir():
            self._files = sorted(p for p in path.iterdir() if p.suffix.lower() in self.SUFFIXES)
        else:
            raise InputError(f"{path}: there is no such folder of photographs", file=str(path))
        if not self._files:
            raise InputError(f"{path}: holds no photograph ({', '.join(self.SUFFIXES)})", file=str(path))

    def grab(self, count: int) -> list[Image]:
        """The first `count` photographs, grey; fewer if the folder holds fewer.

        Raises:
            InputError: one cannot be decoded.
        """
        import cv2

        frames = []
        for path in self._files[:count]:
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise InputError(f"{path}: cannot be read as an image", file=str(path))
            frames.append(np.asarray(image, dtype=np.uint8))
        return frames
