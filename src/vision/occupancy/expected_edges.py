"""Predict where the image shows borders if a hole holds a cube, and where if it is empty.

A cube in its pocket shows the sides of its top, 32 mm above the plate, and upright edges between its faces. An empty
pocket shows the sides of its mouth, those of its floor 10 mm below, and the rim of the finger hole in the floor
(docs/sources.md, "Boards and cubes"). From a slant the borders of the two states lie apart, for any colours. To be
compared, all are projected from the camera's centre to the plate's top plane z = 0, in m from the hole.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from arm.board import CUBE_SEAT_DEPTH, POCKET_DEPTH, QUIET_ZONE, Board
from arm.se3 import Array, Bools

FINGER_HOLE_RADIUS = 0.008  # m
PITCH = 1.5e-3  # m between stations on a border
CORNER_GAP = 3e-3  # m at each end of a straight border that is not used: another border is near

Kind = Literal["top", "upright", "mouth", "floor", "rim"]


@dataclass(frozen=True, eq=False)
class Border:
    """One border, projected to the plate's plane.

    Attributes:
        kind: "top" or "upright" of a cube; "mouth", "floor" or "rim" (of the finger hole) of an empty pocket.
        points: stations on it, (n, 2) m.
        outward: unit normals there, (n, 2).
        telling: stations where the other state has a smooth surface, so that the border is evidence, (n,).
        clear: stations that nothing hides, (n,).
    """

    kind: Kind
    points: Array
    outward: Array
    telling: Bools
    clear: Bools


def marker_squares(board: Board) -> tuple[Array, Array]:
    """Centres of both markers, (2, 3) m in the board frame, and a grid over a marker and its white border, (n, 2) m."""
    half = board.marker_size * (0.5 + QUIET_ZONE)
    side = np.linspace(-half, half, 21)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    return board.marker_corners().mean(axis=1), grid


def seen_on_plate(points: Array, height: float, eye: Array) -> Array:
    """Project points (..., 2) m at a height above the plate to its plane, as seen from `eye` (3,) m."""
    return np.asarray(eye[:2] + (points - eye[:2]) * (eye[2] / (eye[2] - height)))


def hole_borders(
    board: Board, index: int, eye: Array, cube_size: float, near: float
) -> tuple[list[Border], list[Border]]:
    """Return the borders of a hole with a cube, and those of the empty hole, the rim last.

    Args:
        board: board with the hole.
        index: number of the hole, 0 to 3.
        eye: the camera's centre in the board frame, (3,) m, above the plate.
        cube_size: edge of a cube, m.
        near: distance within which two borders disturb each other, m.
    """
    hole = board.holes[index]
    eye = eye - hole
    top_height = cube_size - CUBE_SEAT_DEPTH
    top, foot = seen_on_plate(_square(cube_size), top_height, eye), _square(cube_size)
    mouth_width, floor_width = board.pocket
    mouth, floor = _square(mouth_width), seen_on_plate(_square(floor_width), -POCKET_DEPTH, eye)
    angle = 2.0 * np.pi * np.arange(36) / 36
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    cube_lines = [*_sides("top", top), *_uprights(top, foot, eye, cube_size)]
    rim = _border("rim", seen_on_plate(FINGER_HOLE_RADIUS * circle, -POCKET_DEPTH, eye), circle)
    empty_lines = [*_sides("mouth", mouth), *_sides("floor", floor), rim]
    outline = np.asarray(cv2.convexHull(np.concatenate([top, foot]).astype(np.float32)))[:, 0].astype(float)
    cube_edges = [_closed(top), _closed(outline), *(line.points for line in cube_lines[4:])]
    empty_edges = [_closed(mouth), _closed(floor), rim.points]

    cube, empty = [], []
    for line in cube_lines:
        p = line.points
        telling = _plain(p, board, hole, near) & ~_close_to(p, empty_edges, near)
        cube.append(replace(line, telling=telling))
    for line in empty_lines:
        p = line.points
        clear = line.clear if line.kind == "mouth" else _depth_in(mouth, p) > near
        covered = (_depth_in(outline, p) > near) & ~_close_to(p, cube_edges, near)
        empty.append(replace(line, telling=clear & covered, clear=clear))
    return cube, empty


def _border(kind: Kind, points: Array, outward: Array) -> Border:
    everywhere = np.ones(len(points), dtype=bool)
    return Border(kind, points, outward, everywhere, everywhere)


def _square(width: float) -> Array:
    """Corners (4, 2), counter-clockwise seen from above."""
    return np.asarray(width / 2.0 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))


def _stations(kind: Kind, start: Array, end: Array) -> Border:
    length = float(np.linalg.norm(end - start))
    count = max(int((length - 2.0 * CORNER_GAP) / PITCH), 0)
    along = CORNER_GAP + (length - 2.0 * CORNER_GAP) * (np.arange(count) + 0.5) / max(count, 1)
    direction = (end - start) / max(length, 1e-9)
    points = start + along[:, None] * direction
    return _border(kind, points, np.tile([direction[1], -direction[0]], (count, 1)))


def _sides(kind: Kind, corners: Array) -> list[Border]:
    return [_stations(kind, corners[k], corners[(k + 1) % 4]) for k in range(4)]


def _uprights(top: Array, foot: Array, eye: Array, cube_size: float) -> list[Border]:
    """Upright edges with at least one face towards the camera, from the top down to the plate."""
    # distance of the eye along the normal of the side that begins at each corner
    distances = (-eye[1], eye[0], eye[1], -eye[0])
    faces = [distance > cube_size / 2.0 for distance in distances]
    return [_stations("upright", top[k], foot[k]) for k in range(4) if faces[k] or faces[k - 1]]


def _closed(corners: Array, pitch: float = 0.5e-3) -> Array:
    """Points on the outline of a polygon, about `pitch` m apart."""
    sides = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(int(np.linalg.norm(b - a) / pitch), 1)
        sides.append(a + (np.arange(count) / count)[:, None] * (b - a))
    return np.concatenate(sides)


def _close_to(points: Array, edges: list[Array], near: float) -> Bools:
    others = np.concatenate(edges)
    return np.asarray(np.linalg.norm(points[:, None] - others[None], axis=-1).min(axis=1) < near, dtype=bool)


def _depth_in(corners: Array, points: Array) -> Array:
    """Depth of points (n, 2) inside a convex polygon, m; negative outside."""
    following = np.roll(corners, -1, axis=0)
    sides = following - corners
    area = (corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]).sum()  # signed, doubled
    normals = np.sign(area) * np.stack([-sides[:, 1], sides[:, 0]], axis=-1)
    length = np.maximum(np.linalg.norm(normals, axis=-1), 1e-12)
    depths = ((points[:, None] - corners) * normals).sum(axis=-1) / length
    return np.asarray(depths[:, length > 1e-6].min(axis=1))


def _plain(points: Array, board: Board, hole: Array, near: float) -> Bools:
    """Which points lie on bare plate, at least `near` m from its edges, markers and other pockets."""
    on_plate = points + hole[:2]
    good = (board.plate.edge_distances(on_plate) > near).all(axis=-1)
    centres, grid = marker_squares(board)
    for centre in centres:
        good &= np.abs(on_plate - centre[:2]).max(axis=-1) > grid.max() + near
    for other in board.holes:
        if not np.array_equal(other, hole):
            good &= np.abs(on_plate - other[:2]).max(axis=-1) > board.pocket[0] / 2.0 + near
    return np.asarray(good, dtype=bool)
