"""Images of the cell as its camera would take them.

Every pixel's ray is met with every body; the nearest wins. One ray a pixel first, then 4 x 4 rays where neighbours
differ (edges of bodies, faces and printed cells), so edges are placed exactly and the rest costs little. The lens's
blur comes last. Bodies cast no shadows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.board import PLATE_SIZE, Board
from arm.bodies import Body, Box, Cylinder, Sphere
from arm.se3 import Array, apply, inverse
from cell.furniture import plate_name
from cell.render.decals import PlateDecals
from cell.render.rays import PixelRays, pixel_rays
from cell.render.surfaces import ALBEDO, BodyRays, Hit, lambert, meet
from vision.camera import Camera, Image

BACKGROUND = 60.0
SUBSAMPLES = 4
EDGE_GREY = 1.5  # neighbours that differ by more are an edge
MARGIN_PX = 3.0
NEAREST = 0.05  # m, bodies nearer to the camera's plane may cover any pixel


@dataclass(frozen=True)
class PlacedBoard:
    """A board whose markers and pockets are drawn on its plate (the body of `cell.furniture.plate_body`)."""

    board: Board
    T_base_board: Array


def render(
    camera: Camera,
    bodies: Sequence[Body],
    boards: Sequence[PlacedBoard],
    dictionary: str = "DICT_4X4_50",
    psf_px: float = 0.7,
) -> npt.NDArray[np.float32]:
    """The noise-free image, (h, w) grey levels from 0 to 255.

    Args:
        camera: lens, size and place.
        bodies: everything in view, plates included.
        boards: what is on the plates.
        dictionary: of the markers.
        psf_px: standard deviation of the lens's blur.
    """
    scene = _Scene(camera, bodies, boards, dictionary)
    rays = pixel_rays(camera)
    grey = scene.whole(rays)
    rows, columns = _edges(grey)
    grey[rows, columns] = _supersampled(scene, rays, rows, columns)
    image = grey.astype(np.float32)
    if psf_px > 0.0:
        image = np.asarray(cv2.GaussianBlur(image, (0, 0), psf_px, borderType=cv2.BORDER_REPLICATE))
    return image


def with_noise(image: npt.NDArray[np.float32], rng: np.random.Generator, sigma_grey: float = 2.0) -> Image:
    """A photograph: the image with Gaussian noise, rounded to grey levels."""
    noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(sigma_grey)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


class _Scene:
    """Bodies with the part of the image that each can cover."""

    def __init__(
        self, camera: Camera, bodies: Sequence[Body], boards: Sequence[PlacedBoard], dictionary: str
    ) -> None:
        self.camera = camera
        self.boards = {
            plate_name(b.board.name): (PlateDecals(b.board, dictionary), b.T_base_board) for b in boards
        }
        self.placed = [(body, *_cover(camera, body)) for body in bodies]

    def whole(self, rays: PixelRays) -> Array:
        """One ray a pixel."""
        grey = np.full(rays.x.shape, BACKGROUND)
        depth = np.full(rays.x.shape, np.inf)
        for body, low, high in self.placed:
            area = np.s_[low[1] : high[1] + 1, low[0] : high[0] + 1]
            x, y = rays.x[area], rays.y[area]
            if x.size:
                self._draw(body, x, y, grey[area], depth[area])
        return grey

    def some(self, rows: Array, columns: Array, x: Array, y: Array) -> Array:
        """Rays (n,) that belong to pixels (n,)."""
        grey = np.full(x.shape, BACKGROUND)
        depth = np.full(x.shape, np.inf)
        for body, low, high in self.placed:
            inside = (columns >= low[0]) & (columns <= high[0]) & (rows >= low[1]) & (rows <= high[1])
            index = np.flatnonzero(inside)
            if len(index):
                part_grey, part_depth = grey[index], depth[index]
                self._draw(body, x[index], y[index], part_grey, part_depth)
                grey[index], depth[index] = part_grey, part_depth
        return grey

    def _draw(self, body: Body, x: Array, y: Array, grey: Array, depth: Array) -> None:
        rays = BodyRays(body.T_base_body, self.camera.T_base_camera, x, y)
        hit = meet(body, rays)
        nearer = hit.depth < depth
        if body.name in self.boards:
            self._decorate(body, hit, nearer, x, y)
        depth[nearer] = hit.depth[nearer]
        grey[nearer] = hit.grey[nearer]

    def _decorate(self, body: Body, hit: Hit, nearer: npt.NDArray[np.bool_], x: Array, y: Array) -> None:
        decals, T_base_board = self.boards[body.name]
        x, y = x[nearer], y[nearer]
        rays = BodyRays(T_base_board, self.camera.T_base_camera, x, y)
        bx, by, bz = rays.points(hit.depth[nearer])
        top = np.flatnonzero(np.abs(bz) < 1e-3 * PLATE_SIZE[2])
        albedo = np.full(len(top), ALBEDO["board"])
        dx, dy, dz = (d[top] for d in rays.direction)
        decals.paint(albedo, bx[top], by[top], -dx / dz, -dy / dz)
        values = hit.grey[nearer]
        values[top] = albedo * lambert(T_base_board[:3, 2])
        hit.grey[nearer] = values


def _cover(camera: Camera, body: Body) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """First and last pixel (column, row) that a body can cover."""
    width, height = camera.size
    half = _half_extent(body)
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * half
    points = apply(inverse(camera.T_base_camera) @ body.T_base_body, corners)
    last = np.array([width - 1, height - 1])
    if points[:, 2].min() < NEAREST:
        return np.zeros(2, dtype=np.int64), last
    pixels = camera.project(points)
    low = np.clip(np.floor(pixels.min(axis=0) - MARGIN_PX), 0, last + 1)
    high = np.clip(np.ceil(pixels.max(axis=0) + MARGIN_PX), -1, last)
    return low.astype(np.int64), high.astype(np.int64)


def _half_extent(body: Body) -> Array:
    match body.shape:
        case Box(size):
            return np.array(size) / 2.0
        case Cylinder(radius, length):
            return np.array([radius, radius, length / 2.0])
        case Sphere(radius):
            return np.full(3, radius)


def _edges(grey: Array) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows and columns of pixels that differ from a neighbour, or whose neighbour does."""
    edge = np.zeros(grey.shape, dtype=np.uint8)
    down = np.abs(np.diff(grey, axis=0)) > EDGE_GREY
    right = np.abs(np.diff(grey, axis=1)) > EDGE_GREY
    edge[:-1] |= down
    edge[1:] |= down
    edge[:, :-1] |= right
    edge[:, 1:] |= right
    rows, columns = np.nonzero(cv2.dilate(edge, np.ones((3, 3), dtype=np.uint8)))
    return rows, columns


def _supersampled(
    scene: _Scene, rays: PixelRays, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]
) -> Array:
    offsets = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    total = np.zeros(len(rows))
    for dv in offsets:
        for du in offsets:
            x, y = rays.between(rows, columns, du, dv)
            total += scene.some(rows, columns, x, y)
    return total / SUBSAMPLES**2
