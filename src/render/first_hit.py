"""First hit of each ray among all solids."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from arm.se3 import Array
from render.light import BACKGROUND_GREY
from render.rays import Floats, PixelRays
from render.solids import REGIONS, Solid
from render.window import Window, cells_of, window_of

NOTHING = 0  # surface of rays that hit nothing


@dataclass(frozen=True, eq=False)
class InView:
    """A solid that may be in the image: its number (from 1) and the part of the image that it can cover."""

    number: int
    solid: Solid
    window: Window


@dataclass(frozen=True, eq=False)
class FirstHits:
    """Hits of rays of any shape: depth m (infinite for misses), grey level, and surface.

    `surface` is REGIONS times the solid's number plus its region, or NOTHING.
    """

    depth: Floats
    grey: Floats
    surface: npt.NDArray[np.uint16]


def in_view(solids: Sequence[Solid], T_base_camera: Array, rays: PixelRays) -> list[InView]:
    """Return the solids that may be in an image with these rays."""
    cells = cells_of(rays)
    windows = [window_of(s.T_base_solid, s.half_extent, T_base_camera, cells) for s in solids]
    return [
        InView(number, solid, window)
        for number, (solid, window) in enumerate(zip(solids, windows, strict=True), start=1)
        if window is not None
    ]


def no_hits(shape: tuple[int, ...]) -> FirstHits:
    """Return the result before any solid is tested."""
    return FirstHits(
        np.full(shape, np.inf, dtype=np.float32),
        np.full(shape, BACKGROUND_GREY, dtype=np.float32),
        np.full(shape, NOTHING, dtype=np.uint16),
    )


def first_hits(solids: Sequence[InView], T_base_camera: Array, rays: PixelRays) -> FirstHits:
    """Return the first hits of the rays (h, w) of an image."""
    hits = no_hits(rays.x.shape)
    for item in solids:
        depth, grey, surface = (f[item.window.area] for f in (hits.depth, hits.grey, hits.surface))
        cast = item.solid.cast(T_base_camera, item.window.cut(rays))
        nearer = cast.depth < depth
        np.copyto(depth, cast.depth, where=nearer)
        np.copyto(grey, cast.grey, where=nearer)
        np.copyto(surface, np.uint16(item.number * REGIONS) + cast.region, where=nearer)
    return hits
