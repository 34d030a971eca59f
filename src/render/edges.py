"""Antialiasing: pixels on edges get many rays instead of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from arm.errors import InputError
from arm.se3 import Array, Bools, Indices
from render.first_hit import FirstHits, InView, no_hits
from render.rays import PixelRays, subpixel_rays
from render.solids import REGIONS

NEIGHBOURS = np.ones((3, 3), dtype=np.uint8)


@dataclass(frozen=True, eq=False)
class EdgeSample:
    """One ray in every edge pixel, and its first hit."""

    rays: PixelRays
    hits: FirstHits


def edge_pixels(surface: npt.NDArray[np.uint16]) -> Bools:
    """Return the pixels (h, w) whose 3 x 3 neighbourhood shows more than one surface."""
    return np.asarray(cv2.dilate(surface, NEIGHBOURS) != cv2.erode(surface, NEIGHBOURS))


def pixel_offsets(count: int) -> Array:
    """Return positions (count, 2) in a pixel, px from its centre: Hammersley points, `count` a power of two.

    All columns and all rows differ, so an edge along the pixels is located to 1/count px. A square grid of `count`
    points would locate it to 1/sqrt(count) px (J. H. Halton, 1960; van der Corput's sequence in base 2).

    Raises:
        InputError: `count` is not a power of two.
    """
    if count < 1 or count & (count - 1):
        raise InputError(f"samples = {count}: must be a power of two, such as 16", samples=count)
    bits = count.bit_length() - 1
    reversed_bits = [int(f"{i:0{bits}b}"[::-1], 2) if bits else 0 for i in range(count)]
    return (np.stack([np.arange(count), reversed_bits], axis=-1) + 0.5) / count - 0.5


def edge_samples(
    solids: Sequence[InView],
    T_base_camera: Array,
    rays: PixelRays,
    surface: npt.NDArray[np.uint16],
    edge: Bools,
    offsets: Array,
) -> Iterator[EdgeSample]:
    """For each of `offsets` (n, 2) px, yield the rays at that position of all pixels of `edge`, and their first hits.

    A pixel is tested against the solids in its 3 x 3 neighbourhood. A solid that is narrower than a pixel and lies
    between the pixel centres is missed.
    """
    row, column = np.nonzero(edge)
    at_centres = subpixel_rays(rays, row, column)
    tried = _pixels_by_solid(solids, surface, edge)
    for offset in offsets:
        moved = at_centres.moved(float(offset[0]), float(offset[1]))
        hits = no_hits(moved.x.shape)
        for item, pixels in tried:
            cast = item.solid.cast(T_base_camera, PixelRays(moved.x[pixels], moved.y[pixels]))
            nearer = np.flatnonzero(cast.depth < hits.depth[pixels])
            target = pixels[nearer]
            hits.depth[target] = cast.depth[nearer]
            hits.grey[target] = cast.grey[nearer]
            hits.surface[target] = np.uint16(item.number * REGIONS) + cast.region[nearer]
        yield EdgeSample(moved, hits)


def _pixels_by_solid(
    solids: Sequence[InView], surface: npt.NDArray[np.uint16], edge: Bools
) -> list[tuple[InView, Indices]]:
    """Return for each solid the indices of the edge pixels, in order, that show it or are next to one that does."""
    order = np.zeros(edge.shape, dtype=np.int32)
    order[edge] = np.arange(np.count_nonzero(edge))
    tried = []
    for item in solids:
        area = item.window.area
        shown = (surface[area] // REGIONS == item.number).astype(np.uint8)
        near = cv2.dilate(shown, NEIGHBOURS).astype(bool) & edge[area]
        pixels = order[area][near].astype(np.intp)
        if len(pixels):
            tried.append((item, pixels))
    return tried
