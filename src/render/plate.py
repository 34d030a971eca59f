"""A board's plate: a box with two printed markers on it and four square funnels ("pockets") cut into it.

Markers lie in the plane z = 0 of the board frame, the plate's top; each has a white border that is one module wide.
Pockets narrow from mouth to floor and have a finger hole in the floor (docs/sources.md, "Boards and cubes"). They are
darker at depth, because their walls block part of the ambient light.
"""

from __future__ import annotations

import numpy as np

from arm.board import POCKET_DEPTH, Board
from arm.se3 import Array, Bools, Indices, apply, frozen, inverse
from render.light import FINGER_HOLE, KIND_GREY, Light
from render.rays import Bundle, Floats, PixelRays, bundle_in
from render.solids import Cast, cast_box
from render.surface import TOP_FACE, Print
from vision.markers.dictionaries import marker_modules

FINGER_HOLE_RADIUS = 0.008  # m
FLOOR_LIGHT = 0.45  # fraction of the light that reaches a pocket's floor
BLACK, WHITE, WALLS, FLOOR, HOLE = 6, 7, 8, 12, 13  # further regions; four walls


class PlateSolid:
    """A board's plate at a pose, lit.

    Args:
        board: its holes, pocket and marker size are those of the plate.
        T_base_board: pose.
        dictionary: of the markers.
        light: of the cell.
        prints: how its two markers were printed and glued.

    Raises:
        InputError: the board's ids are not in the dictionary.
    """

    def __init__(
        self,
        board: Board,
        T_base_board: Array,
        dictionary: str,
        light: Light,
        prints: tuple[Print, Print] = (Print(), Print()),
    ) -> None:
        self._T_solid_board = inverse(board.plate.T_board_plate)
        self.T_base_solid = frozen(T_base_board @ inverse(self._T_solid_board))
        self.half_extent = np.array(board.plate.size) / 2.0
        self._board = board
        self._light = light
        self._lamp = T_base_board[:3, :3].T @ light.towards(self.T_base_solid[:3, 3])
        centres = [np.zeros(3), np.array([*board.second_marker, 0.0])]
        self._markers = [
            (apply(self._T_solid_board, centre), marker_modules(dictionary, marker_id), how)
            for centre, marker_id, how in zip(centres, board.marker_ids, prints, strict=True)
        ]

    def cast(self, T_base_camera: Array, rays: PixelRays) -> Cast:
        """Cast the rays of a camera at the plate, its print and its pockets."""
        flat = PixelRays(rays.x.reshape(-1), rays.y.reshape(-1))
        bundle = bundle_in(inverse(self.T_base_solid) @ T_base_camera, flat)
        levels = KIND_GREY["board"] * self._light.lambert(np.concatenate([self._lamp, -self._lamp]))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # misses, and rays along a face
            cast = cast_box(self.half_extent, bundle, levels)
        top = np.flatnonzero((cast.region == TOP_FACE) & np.isfinite(cast.depth))
        x = np.float32(bundle.origin[0]) + cast.depth[top] * bundle.dx[top]
        y = np.float32(bundle.origin[1]) + cast.depth[top] * bundle.dy[top]
        for centre, modules, how in self._markers:
            self._print_marker(cast, top, x - np.float32(centre[0]), y - np.float32(centre[1]), modules, how)
        for hole in apply(self._T_solid_board, self._board.holes):
            self._cut_pocket(cast, top, x - np.float32(hole[0]), y - np.float32(hole[1]), bundle)
        shape = rays.x.shape
        return Cast(cast.depth.reshape(shape), cast.grey.reshape(shape), cast.region.reshape(shape))

    def _print_marker(
        self, cast: Cast, top: Indices, x: Floats, y: Floats, modules: Bools, how: Print
    ) -> None:
        """Print a marker where the rays `top` hit the plate's top, at (x, y) m from the marker's centre."""
        size, count = self._board.marker_size, len(modules)
        border = size / 2.0 + size / count
        near = np.flatnonzero((np.abs(x) <= border + how.margin) & (np.abs(y) <= border + how.margin))
        px, py = how.designed(x[near], y[near])
        if how.margin:
            on = (np.abs(px) <= border) & (np.abs(py) <= border)
            near, px, py = near[on], px[on], py[on]
        white = np.pad(modules, 1, constant_values=True)

        def designed_white(x: Floats, y: Floats) -> Bools:
            if how.border:  # the frame is wider: its points belong to the edge of the design
                half = np.float32(size / 2.0)
                on = np.maximum(np.abs(x), np.abs(y)) < half + np.float32(how.border)
                most = np.nextafter(half, np.float32(0.0))
                x, y = (np.where(on, np.clip(v, -most, most), v) for v in (x, y))
            column = np.floor((x / size + 0.5) * count).astype(np.intp) + 1
            row = np.floor((0.5 - y / size) * count).astype(np.intp) + 1
            return np.asarray(white[np.clip(row, 0, count + 1), np.clip(column, 0, count + 1)])

        is_white = how.white_at(designed_white, px, py)
        lit = self._light.lambert(self._lamp[2])
        cast.grey[top[near]] = np.where(is_white, how.white, how.black) * lit
        cast.region[top[near]] = np.where(is_white, WHITE, BLACK)

    def _cut_pocket(self, cast: Cast, top: Indices, x: Floats, y: Floats, rays: Bundle) -> None:
        """Continue the rays `top`, which hit the plate's top at (x, y) m from a mouth's centre, to a wall or floor."""
        mouth = np.float32(self._board.pocket[0] / 2.0)
        near = np.flatnonzero((np.abs(x) < mouth) & (np.abs(y) < mouth))
        if not len(near):
            return
        x, y, ray = x[near], y[near], top[near]
        dx, dy, dz = rays.dx[ray], rays.dy[ray], rays.dz[ray]
        slope = np.float32((self._board.pocket[0] - self._board.pocket[1]) / 2.0 / POCKET_DEPTH)
        walls = [
            (mouth - s * p) / np.maximum(s * d - slope * dz, 1e-9)
            for s in (1, -1)
            for p, d in ((x, dx), (y, dy))
        ]
        further = np.stack([*walls, np.float32(POCKET_DEPTH) / -dz])
        piece = np.argmin(further, axis=0)
        further = further[piece, np.arange(len(near))]
        depth_below = -further * dz
        # inward normals of the walls +x, +y, -x, -y, and of the floor
        up = slope / np.hypot(1.0, slope)
        across = 1.0 / np.hypot(1.0, slope)
        normals = np.array([[-across, 0, up], [0, -across, up], [across, 0, up], [0, across, up], [0, 0, 1]])
        open_sky = 1.0 - (1.0 - FLOOR_LIGHT) * depth_below / np.float32(POCKET_DEPTH)
        levels = KIND_GREY["board"] * self._light.lambert(normals @ self._lamp)
        hole = (piece == 4) & (np.hypot(x + further * dx, y + further * dy) < FINGER_HOLE_RADIUS)
        cast.depth[ray] += further
        cast.grey[ray] = np.where(hole, FINGER_HOLE * self._light.gain, levels[piece] * open_sky)
        cast.region[ray] = np.where(hole, HOLE, np.where(piece == 4, FLOOR, WALLS + piece))
