"""The cubes of the simulated cell, and boards that move with them while nobody looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.numerics.products import mul
from arm.se3 import Array, frozen, inverse
from cell.files.world import TrueBoard, World


@dataclass(frozen=True)
class SimulatedCube:
    """A cube of the simulated cell.

    Attributes:
        name: ``cube 1`` ...
        T_base_cube: pose of its centre; while held, where it was gripped.
        where: pocket, jaws, table or fallen.
        size: true edge, m.
        T_tool_cube: pose in the tool frame while held, centred between the jaws.
    """

    name: str
    T_base_cube: Array
    where: str
    size: float
    T_tool_cube: Array | None = None


def cubes_on(board: TrueBoard, cubes: Sequence[SimulatedCube]) -> tuple[int, ...]:
    """The numbers of the cubes that rest on a board."""

    def on(cube: SimulatedCube) -> bool:
        T_board_cube = mul(inverse(board.T_base_board), cube.T_base_cube)
        plate = board.board.plate
        near = np.abs(T_board_cube[:2, 3] - plate.centre).max() < max(plate.size) / 2.0
        return bool(cube.where == "pocket" and near)

    return tuple(number for number, cube in enumerate(cubes) if on(cube))


def with_shifted(
    world: World, cubes: Sequence[SimulatedCube], board: TrueBoard, T_shift: Array
) -> tuple[World, list[SimulatedCube]]:
    """The world and its cubes after a motion T_shift (4, 4) of a board in the base frame."""
    moved = list(cubes)
    for number in cubes_on(board, cubes):
        T_base_cube = frozen(mul(T_shift, cubes[number].T_base_cube))
        moved[number] = replace(cubes[number], T_base_cube=T_base_cube)
    boards = tuple(b.shifted(T_shift) if b is board else b for b in world.boards)
    return replace(world, boards=boards), moved


def shifting_after(world: World, grasps: int) -> tuple[TrueBoard, ...]:
    """The boards that move after the grasp of this number, counted from 1."""
    return tuple(b for b in world.boards if b.shift is not None and b.shifts_after == grasps)
