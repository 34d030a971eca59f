"""A calibration target: a thin plate, flat or bent, with a printed chessboard and markers."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, frozen, inverse, transform
from render.light import Light
from render.rays import Floats, PixelRays, bundle_in
from render.solids import Cast
from render.surface import Print
from vision.markers.dictionaries import marker_modules
from vision.targets.target import Target

MARGIN = 0.012  # m of white paper around the chessboard
_BENT_STEPS = 6  # iterations for a bent plate; each reduces the error by a factor of about 20


class TargetSolid:
    """A target at a pose, lit; the lamp shines on its front.

    Args:
        target: nominal print.
        T_base_target: its frame, see `vision.targets.target`.
        light: the light in the cell.
        bend: bulge of its middle towards the viewer relative to the chessboard's left and right edges, m.
        true_marker: edge of the markers as printed, m; default: that of `target`.
        how: how it was printed; where it is glued is part of `T_base_target`.
    """

    def __init__(
        self,
        target: Target,
        T_base_target: Array,
        light: Light,
        bend: float = 0.0,
        true_marker: float | None = None,
        how: Print | None = None,
    ) -> None:
        width, height = target.size
        self._how = how or Print()
        self._half = self._how.scale * np.array([width / 2.0 + MARGIN, height / 2.0 + MARGIN])
        self.T_base_solid = frozen(T_base_target @ transform(t=(width / 2.0, height / 2.0, 0.0)))
        self.half_extent = np.array([*self._half, abs(bend) + 1e-4])
        self._target = target
        self._bend = bend
        self._marker = target.marker if true_marker is None else true_marker
        normal = -self.T_base_solid[:3, 2]
        lit = light.lambert(np.abs(normal @ light.towards(self.T_base_solid[:3, 3])))
        self._levels = (np.float32(self._how.black * lit), np.float32(self._how.white * lit))
        # all markers with their black borders, (markers, m, m), True for white
        count = 0 if target.kind == "checkerboard" else len(target.marker_squares())
        self._modules = np.array([marker_modules(target.dictionary, i) for i in range(count)])

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at the plate. Regions: 0 ink, 1 paper, 2 the paper's margin."""
        flat = PixelRays(rays.x.reshape(-1), rays.y.reshape(-1))
        bundle = bundle_in(inverse(self.T_base_solid) @ T_base_camera, flat)
        o = bundle.origin.astype(np.float32)
        target_half = self._target.size[0] / 2.0
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            depth = -o[2] / bundle.dz
            for _ in range(_BENT_STEPS if self._bend else 0):
                x = o[0] + depth * bundle.dx
                rise = np.float32(-self._bend) * (1.0 - (x / np.float32(target_half)) ** 2)
                height = np.clip(rise, -abs(self._bend), abs(self._bend)).astype(np.float32)
                depth = (height - o[2]) / bundle.dz
            x, y = o[0] + depth * bundle.dx, o[1] + depth * bundle.dy
            met = (depth > 0.0) & (np.abs(x) <= self._half[0]) & (np.abs(y) <= self._half[1])
        met &= o[2] < 0.0  # the back is not rendered
        region = np.full(x.shape, 2, dtype=np.uint8)
        hit = np.flatnonzero(met)
        region[hit] = self._print(*self._how.designed(x[hit], y[hit]))
        grey = np.where(region == 0, *self._levels).astype(np.float32)
        depth = np.where(met, depth, np.float32(np.inf)).astype(np.float32)
        shape = rays.x.shape
        return Cast(depth.reshape(shape), grey.reshape(shape), region.reshape(shape))

    def _print(self, x: Floats, y: Floats) -> npt.NDArray[np.uint8]:
        """Return the region of the print, its ink spread, at (x, y) m of the design from the chessboard's centre."""
        region = self._design(x, y)
        if self._how.spread:
            white = self._how.white_at(lambda x, y: self._design(x, y) > 0, x, y)
            region = np.where(white, region, 0).astype(np.uint8)
        return region

    def _design(self, x: Floats, y: Floats) -> npt.NDArray[np.uint8]:
        """Return the region of the print at (x, y) m from the chessboard's centre."""
        target = self._target
        column_at = x / np.float32(target.square) + np.float32(target.columns / 2.0)
        row_at = y / np.float32(target.square) + np.float32(target.rows / 2.0)
        column, row = np.floor(column_at).astype(np.intp), np.floor(row_at).astype(np.intp)
        inside = (column >= 0) & (column < target.columns) & (row >= 0) & (row < target.rows)
        white = (column + row + target.white_first) % 2 == 1
        region = np.where(inside, white, 2).astype(np.uint8)
        if not len(self._modules):
            return region
        number = np.full((target.rows, target.columns), -1)
        for marker, (i, j) in enumerate(target.marker_squares()):
            number[j, i] = marker
        across = self._modules.shape[1]
        share = np.float32(self._marker / target.square)
        u = (column_at - column - np.float32(0.5)) / share + np.float32(0.5)
        v = (row_at - row - np.float32(0.5)) / share + np.float32(0.5)
        on = np.flatnonzero(inside & white & (u >= 0.0) & (u < 1.0) & (v >= 0.0) & (v < 1.0))
        at_u = np.minimum((u[on] * across).astype(np.intp), across - 1)
        at_v = np.minimum((v[on] * across).astype(np.intp), across - 1)
        region[on] = self._modules[number[row[on], column[on]], at_v, at_u]
        return region
