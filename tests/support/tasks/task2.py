"""The default Task 2 of docs/sources.md, "Boards and cubes", as the planner's scene, built from what that page says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arm.board import CUBE_SEAT_DEPTH, PLATE_CENTRE, PLATE_SIZE, Board, read_board_csv
from arm.io.storage import data_file
from arm.robot.model import load_a465
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, frozen, rot_x, rot_z, rotation, transform
from plan.scene import Scene, Station, Transfer

TOOL_LENGTH = 0.134112
JAW_OPENING = 0.06
CUBE = 0.04
GRIP_HEIGHT = 0.015
Q_START = frozen(np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0]))

TABLE = Body("table", Box((1.3, 1.5, 0.04)), transform(t=(0.35, 0.0, -0.02)), "table")
POST = Body("camera post", Box((0.08, 0.08, 1.2)), transform(t=(0.93, 0.0, 0.6)), "post")
# between where the arm starts and board B: in the way of straight transits, but not of the lines
WALL = Body("wall", Box((0.4, 0.02, 0.2)), transform(t=(0.42, -0.29, 0.1)), "wall")


@dataclass(frozen=True)
class PlacedBoard:
    """A board and where it stands."""

    board: Board
    T_base_board: Array

    @property
    def plate(self) -> str:
        return f"plate {self.board.name}"

    def T_base_hole(self, index: int) -> Array:
        return frozen(self.T_base_board @ self.board.T_board_hole(index))

    def bodies(self) -> list[Body]:
        """The plate and the stand under it."""
        centre = transform(t=(*PLATE_CENTRE, -PLATE_SIZE[2] / 2))
        plate = Body(self.plate, Box(PLATE_SIZE), frozen(self.T_base_board @ centre), "board")
        corners = [
            (PLATE_CENTRE[0] + i * 0.06, PLATE_CENTRE[1] + j * 0.06, -PLATE_SIZE[2])
            for i in (-1, 1)
            for j in (-1, 1)
        ]
        top = float(apply(self.T_base_board, corners)[:, 2].min()) - 1e-3
        if top < 2e-3:
            return [plate]
        x, y, _ = apply(self.T_base_board, (*PLATE_CENTRE, -PLATE_SIZE[2]))
        yaw = float(np.arctan2(self.T_base_board[1, 0], self.T_base_board[0, 0]))
        stand = Box((0.12, 0.12, top))
        return [
            plate,
            Body(f"stand {self.board.name}", stand, transform(rot_z(yaw), (x, y, top / 2)), "stand"),
        ]

    def station(self, index: int, gap: float = 0.0) -> Station:
        """The four grips of a hole, `gap` m above where the cube sits."""
        grips = [
            transform(rot_x(np.pi) @ rot_z(k * np.pi / 2), (0.0, 0.0, GRIP_HEIGHT + gap)) for k in range(4)
        ]
        return Station(
            f"{self.board.name}/{index + 1}",
            tuple(frozen(self.T_base_hole(index) @ T) for T in grips),
            frozenset((self.plate,)),
        )


def placed_board(
    name: str, centre: Sequence[float], yaw_deg: float, tilt_deg: float, azimuth_deg: float
) -> PlacedBoard:
    """A board by the centre of its top, and the direction (`azimuth_deg`) in which the normal leans."""
    board = read_board_csv(data_file(f"scenes/boards/positions_plate_{name}.csv"), 0.036)
    yaw, tilt, azimuth = np.radians([yaw_deg, tilt_deg, azimuth_deg])
    R = rotation(tilt * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])) @ rot_z(yaw)
    return PlacedBoard(board, transform(R, np.array(centre) - R @ np.array([*PLATE_CENTRE, 0.0])))


BOARD_A = ("01-02", (0.46, 0.11, 0.04), 175.0, 7.0, 265.0)
BOARD_B = ("03-04", (0.46, -0.13, 0.09), 90.0, 15.0, 270.0)


@dataclass(frozen=True)
class Task2:
    """Scene and transfers."""

    scene: Scene
    transfers: tuple[Transfer, ...]


def task2(extra: Sequence[Body] = (), cubes: int = 4) -> Task2:
    """Cubes in the holes of board A, to go to the holes of board B; `extra` bodies stand around."""
    a, b = placed_board(*BOARD_A), placed_board(*BOARD_B)
    T_hole_cube = transform(t=(0.0, 0.0, CUBE / 2 - CUBE_SEAT_DEPTH))
    standing = [
        Body(f"cube {i + 1}", Box((CUBE,) * 3), frozen(a.T_base_hole(i) @ T_hole_cube), "cube")
        for i in range(4)
    ]
    scene = Scene(
        load_a465(TOOL_LENGTH, JAW_OPENING),
        load_a465(TOOL_LENGTH, CUBE),
        (TABLE, POST, *a.bodies(), *b.bodies(), *extra),
        tuple(standing),
        frozenset(frozenset((c.name, a.plate)) for c in standing),
    )
    transfers = tuple(Transfer(standing[i].name, a.station(i), b.station(i, gap=1e-3)) for i in range(cubes))
    return Task2(scene, transfers)
