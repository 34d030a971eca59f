"""A table with specks and scratches, drawn without rays: each is a small Gaussian at its exact place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.se3 import Array, moved
from pictures.boards import lab_camera
from vision.camera.model import Camera, Image

RADIUS = 12  # px about a speck


@dataclass(frozen=True, eq=False)
class ScratchedTable:
    """Specks on the table z = 0: places (n, 3) m, depths (n,) in grey levels, and radii (n,) px."""

    points: Array
    depths: Array
    radii: Array

    def image(
        self, camera: Camera, noise: float = 2.0, seed: int = 0, gain: float = 1.0, shade: bool = False
    ) -> Image:
        """Image by a camera; `shade`: one half of the table is darker, with a soft edge."""
        width, height = camera.size
        picture = np.full((height, width), 190.0)
        for (x, y), depth, radius in zip(
            camera.project_base(self.points), self.depths, self.radii, strict=True
        ):
            u, v = round(float(x)), round(float(y))
            if not (RADIUS <= u < width - RADIUS and RADIUS <= v < height - RADIUS):
                continue
            rows, columns = np.mgrid[v - RADIUS : v + RADIUS + 1, u - RADIUS : u + RADIUS + 1]
            away = ((columns - x) ** 2 + (rows - y) ** 2) / radius**2
            picture[v - RADIUS : v + RADIUS + 1, u - RADIUS : u + RADIUS + 1] -= depth * np.exp(-away / 2.0)
        if shade:
            picture *= 0.9 + 0.1 * np.tanh((np.arange(width) - width / 2.0) / 60.0)
        picture = gain * picture + np.random.default_rng(seed).normal(0.0, noise, picture.shape)
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def scratched_table(seed: int = 0, count: int = 250) -> ScratchedTable:
    """Specks all over what the lab's camera sees of the table."""
    rng = np.random.default_rng(seed)
    camera = lab_camera()
    rays = np.insert(camera.normalised(rng.uniform((0, 0), camera.size, (count, 2))), 2, 1.0, axis=1)
    R, t = camera.T_base_camera[:3, :3], camera.T_base_camera[:3, 3]
    directions = rays @ R.T
    points = t - directions * (t[2] / directions[:, 2])[:, None]
    return ScratchedTable(points, rng.uniform(15.0, 70.0, count), rng.uniform(1.2, 2.5, count))


def turned(
    camera: Camera, degrees: tuple[float, float, float], shift: tuple[float, float, float] = (0, 0, 0)
) -> Camera:
    """The camera rotated about its own axes, and shifted along them (m)."""
    return camera.at(moved(camera.T_base_camera, np.array([*shift, *np.radians(degrees)])))
