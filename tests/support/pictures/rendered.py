"""A table with a board and cubes, and a close view of one marker with the world file's errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from arm.board import Board, read_board_csv
from arm.io.storage import data_file
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, transform
from cell.files.world import World, board_placement, read_world
from cell.scene.bodies import T_hole_cube, cube_body
from render.light import Light
from render.renderer import PlacedBoard
from vision.camera.model import Camera, Image, read_camera
from vision.markers.detect import detect_markers

TABLE = Body("table", Box((1.3, 1.5, 0.04)), transform(t=(0.35, 0.0, -0.02)), "table")


def board_with_cubes(holes: tuple[int, ...]) -> tuple[PlacedBoard, list[Body]]:
    board = read_board_csv(data_file("scenes/boards/positions_plate_01-02.csv"), 0.036)
    T = board_placement((0.46, 0.0, 0.06), *np.radians((175.0, 7.0, 265.0)))
    seat = T_hole_cube(0.04)
    cubes = [cube_body(f"cube {h}", 0.04, T @ board.T_board_hole(h) @ seat) for h in holes]
    return PlacedBoard(board, T), cubes


def grey_at(image: npt.NDArray[np.float32], camera: Camera, point: npt.ArrayLike) -> float:
    u, v = np.rint(camera.project_base(point)).astype(int)
    return float(image[v, u])


SHADOWLESS = Light(shadow=0.0)
FLAT = """
[[boards]]
file = "{board}"
centre_mm = [460, 0, 40]
yaw_deg = 175
tilt_deg = 0
cubes = [1]
"""


def world_with(folder: Path, keys: str) -> World:
    """A world of one flat board with these lines of a world file."""
    path = folder / "some.world.toml"
    path.write_text(keys + FLAT.format(board=data_file("scenes/boards/positions_plate_01-02.csv")))
    return read_world(path, 0.036)


def changed(world: World, part: str, **values: Any) -> World:
    """The world with other values of a table."""
    return replace(world, **{part: replace(getattr(world, part), **values)})


def nominal_board() -> Board:
    return read_board_csv(data_file("scenes/boards/positions_plate_01-02.csv"), 0.036)


def marker_camera(
    T_base_board: Array, point: tuple[float, float, float] = (0, 0, 0), half: int = 110
) -> Camera:
    """The lab's camera, its image cut out around a point of a board."""
    lab = read_camera(data_file("scenes/cameras/lab.toml"))
    u, v = np.rint(lab.project_base((T_base_board @ np.array([*point, 1.0]))[:3])) - half
    K = lab.K.copy()
    K[:2, 2] -= (u, v)
    return Camera(frozen(K), lab.distortion, (2 * half, 2 * half), lab.T_base_camera)


def corners(image: Image, camera: Camera) -> Array:
    """Corners (4, 2) px of the one marker in an image."""
    (marker,) = detect_markers(image, camera)
    return marker.corners_px
