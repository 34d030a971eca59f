"""A calibration target: a thin plate, flat or bent, with a printed chessboard and markers."""

from __future__ import annotations

from itertools import product

import numpy as np
import numpy.typing as npt

from arm.se3 import Array, Indices, frozen, inverse, transform
from render.light import Light
from render.rays import Floats, PixelRays, bundle_in
from render.solids import Cast
from render.surface import Print
from vision.markers.dictionaries import marker_modules
from vision.targets.target import Target

MARGIN = 0.012  # m of white paper around the chessboard
MARGIN_REGION = 2  # beside 0 for ink and 1 for paper
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
        self._modules = 0  # of a marker, along each side
        self._parts = self._design()

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
        region = np.full(x.shape, MARGIN_REGION, dtype=np.uint8)
        hit = np.flatnonzero(met)
        region[hit] = self._print(*self._how.designed(x[hit], y[hit]))
        grey = np.where(region == 0, *self._levels).astype(np.float32)
        depth = np.where(met, depth, np.float32(np.inf)).astype(np.float32)
        shape = rays.x.shape
        return Cast(depth.reshape(shape), grey.reshape(shape), region.reshape(shape))

    def _design(self) -> npt.NDArray[np.uint8]:
        """Return the region of each part of the print by its row and column, with a frame of the paper's margin.

        Each square is one part per module of its marker wide, and one more on either side; so is it high.
        """
        target = self._target
        squares = target.marker_squares() if target.kind == "charuco" else []
        modules = [marker_modules(target.dictionary, i) for i in range(len(squares))]  # True for white
        self._modules = len(modules[0]) if modules else 0
        row, column = np.ogrid[: target.rows, : target.columns]
        white = ((column + row + target.white_first) % 2).astype(np.uint8)
        wide = self._modules + 2
        parts = np.repeat(np.repeat(white, wide, axis=0), wide, axis=1)
        for (i, j), marker in zip(squares, modules, strict=True):
            parts[j * wide + 1 : (j + 1) * wide - 1, i * wide + 1 : (i + 1) * wide - 1] = marker
        return np.pad(parts, 1, constant_values=MARGIN_REGION)

    def _print(self, x: Floats, y: Floats) -> npt.NDArray[np.uint8]:
        """Return the region of the print, its ink spread, at (x, y) m of the design from the chessboard's centre."""
        columns, rows = self._target.columns, self._target.rows
        region = self._regions(self._part_at(y, rows), self._part_at(x, columns))
        if self._how.spread:
            spread = np.float32(self._how.spread)
            row_range, column_range = (
                [self._part_at(at - spread, count), self._part_at(at + spread, count)]
                for at, count in ((y, rows), (x, columns))
            )
            for row, column in product(row_range, column_range):
                region[self._regions(row, column) == 0] = 0
        return region

    def _regions(self, row: Indices, column: Indices) -> npt.NDArray[np.uint8]:
        """Return the regions (n,) of parts by row and column, (n,) each."""
        return np.asarray(np.take(self._parts, row * self._parts.shape[1] + column))

    def _part_at(self, x: Floats, squares: int) -> Indices:
        """Return the column of parts (n,) at `x` (n,) m from the middle of so many squares; rows likewise."""
        at = x / np.float32(self._target.square) + np.float32(squares / 2.0)
        square = np.floor(at)
        wide = self._modules + 2
        # A chessboard's markers have no size: both parts of a square are alike.
        part = square * wide + 1
        if self._modules:
            share = np.float32(self._marker / self._target.square)
            module = np.floor(((at - square - np.float32(0.5)) / share + np.float32(0.5)) * self._modules)
            part += np.clip(module, -1, self._modules) + 1
        return np.asarray(np.clip(part, 0, squares * wide + 1), dtype=np.intp)
