"""A table with a board and cubes."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from arm.board import read_board_csv
from arm.io.storage import data_file
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from cell.files.world import board_placement
from cell.scene.bodies import T_hole_cube, cube_body
from render.renderer import PlacedBoard
from vision.camera.model import Camera

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
