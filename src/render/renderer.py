"""Render images of the cell as its camera would take them.

One ray through the centre of each pixel is tested against every solid that may be there, and the nearest hit counts.
Then pixels whose neighbourhood shows more than one smooth surface get sixteen rays, which are tested only against the
solids in that neighbourhood. So edges are accurate at little cost. The blur of the lens is applied last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from arm.board import Board, plate_name
from arm.robot.shapes import Body
from arm.se3 import Array
from render.edges import edge_pixels, edge_samples, pixel_offsets
from render.first_hit import FirstHits, first_hits, in_view
from render.light import Light
from render.plate import PlateSolid
from render.rays import Floats, PixelRays, pixel_rays
from render.shadow import Shadow
from render.solids import BodySolid, Solid
from render.surface import Print
from vision.camera.model import Camera, Image


@dataclass(frozen=True)
class PlacedBoard:
    """A board at a pose, to be rendered with its markers and pockets."""

    board: Board
    T_base_board: Array
    prints: tuple[Print, Print] = (Print(), Print())


@dataclass(frozen=True)
class Exposure:
    """How the sensor turns light into grey levels; the default leaves them unchanged.

    Attributes:
        gain: factor on all grey levels.
        gamma: grey = 255 (light / 255)^gamma.
        gradient: change of brightness from the middle of the image to its right and its lower edge, as a fraction.
    """

    gain: float = 1.0
    gamma: float = 1.0
    gradient: tuple[float, float] = (0.0, 0.0)


def exposed(image: Floats, exposure: Exposure) -> Floats:
    """Grey levels of a rendered image (h, w) after an exposure; what is above 255 saturates in `with_noise`."""
    height, width = image.shape
    if any(exposure.gradient):
        across, down = (
            np.float32(g) * np.linspace(-1.0, 1.0, n, dtype=np.float32)
            for g, n in zip(exposure.gradient, (width, height), strict=True)
        )
        image = image * (np.float32(1.0) + across[None, :] + down[:, None])
    if exposure.gain != 1.0:
        image = image * np.float32(exposure.gain)
    if exposure.gamma != 1.0:
        scaled = np.maximum(image, np.float32(0.0)) * np.float32(1.0 / 255.0)
        image = np.asarray(cv2.pow(scaled, exposure.gamma), dtype=np.float32) * np.float32(255.0)
    return image


def render(
    camera: Camera,
    bodies: Sequence[Body],
    boards: Sequence[PlacedBoard],
    dictionary: str = "DICT_4X4_50",
    psf_px: float = 0.7,
    light: Light | None = None,
    samples: int = 16,
    others: Sequence[Solid] = (),
    displaced: Array | None = None,
) -> Floats:
    """Render a noise-free image, (h, w) grey levels from 0 to 255.

    Args:
        camera: intrinsics, size and extrinsics.
        bodies: everything in view; may include the plates of `boards`, which are rendered once.
        boards: rendered with their markers and pockets.
        dictionary: of the markers.
        psf_px: standard deviation of the lens's blur, px; 0 for none.
        light: the light in the cell; default: `Light()`.
        samples: rays per pixel at edges, a power of two.
        others: further solids, such as a calibration target.
        displaced: px by which points of the image have moved, see `render.rays.smooth_displacement`.

    Raises:
        InputError: a marker is not in the dictionary, or `samples` is not a power of two.
    """
    light = light or Light()
    plates = {plate_name(b.board.name) for b in boards}
    solids: list[Solid] = [BodySolid(b, light) for b in bodies if b.name not in plates]
    solids += [PlateSolid(b.board, b.T_base_board, dictionary, light, b.prints) for b in boards]
    solids += others
    T_base_camera, rays = camera.T_base_camera, pixel_rays(camera, displaced)
    visible = in_view(solids, T_base_camera, rays)
    hits = first_hits(visible, T_base_camera, rays)
    shadow = Shadow(solids, light, T_base_camera, rays, hits.depth) if light.shadow > 0.0 else None

    image = _lit(hits, rays, light, shadow)
    edge = edge_pixels(hits.surface)
    offsets = pixel_offsets(samples)
    if edge.any():
        total = np.zeros(np.count_nonzero(edge), dtype=np.float32)
        for sample in edge_samples(visible, T_base_camera, rays, hits.surface, edge, offsets):
            total += _lit(sample.hits, sample.rays, light, shadow)
        image[edge] = total / np.float32(samples)
    image *= _vignette(rays, light)
    if psf_px > 0.0:
        cv2.GaussianBlur(image, (0, 0), psf_px, dst=image, borderType=cv2.BORDER_REPLICATE)
    return np.clip(image, 0.0, 255.0, out=image)


def _lit(hits: FirstHits, rays: PixelRays, light: Light, shadow: Shadow | None) -> Floats:
    if shadow is None:
        return hits.grey
    return hits.grey * (np.float32(1.0) - np.float32(light.shadow) * shadow.hidden(rays, hits.depth))


def _vignette(rays: PixelRays, light: Light) -> Floats:
    radius2 = rays.x * rays.x + rays.y * rays.y
    return np.asarray(np.float32(1.0) - np.float32(light.vignette) / radius2.max() * radius2)


def with_noise(image: Floats, rng: np.random.Generator, sigma_grey: float = 2.0) -> Image:
    """Add Gaussian noise of `sigma_grey` and round to whole grey levels, (h, w) uint8."""
    noisy = rng.standard_normal(image.shape, dtype=np.float32)
    noisy *= np.float32(sigma_grey)
    noisy += image
    return np.clip(np.rint(noisy, out=noisy), 0.0, 255.0, out=noisy).astype(np.uint8)
