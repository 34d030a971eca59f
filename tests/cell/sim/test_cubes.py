"""Boards that slide while nobody looks: in their plane, with their cubes, after the grasp that the file names."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.se3 import Array, angle_between, inverse, rot_x, transform
from cell.config.cell_file import read_cell
from cell.files.world import TrueBoard, World, read_world
from cell.sim.cell import SimulatedCell
from cell.sim.cubes import cubes_on, shifting_after, with_shifted
from plan.kinematics.ik import inverse_kinematics

SHIFT = (0.003, -0.002, np.radians(1.5))


def _world(after: int = 1, which: int = 1) -> World:
    world = read_world(data_file("scenes/task2.world.toml"), 0.036)
    boards = list(world.boards)
    boards[which] = replace(boards[which], shift=SHIFT, shifts_after=after)
    return replace(world, boards=tuple(boards))


def _middle(board: TrueBoard) -> Array:
    return board.T_base_board @ np.array([*board.board.plate.centre, 0.0, 1.0])


def test_a_board_slides_in_its_plane_about_its_middle() -> None:
    board = _world().boards[1]
    moved = board.shifted(board.T_shift)
    along = board.T_base_board[:3, :3].T @ (_middle(moved) - _middle(board))[:3]
    assert along == pytest.approx([SHIFT[0], SHIFT[1], 0.0], abs=1e-12)
    assert moved.T_base_board[:3, 2] == pytest.approx(board.T_base_board[:3, 2])
    turned = angle_between(board.T_base_board[:3, :3], moved.T_base_board[:3, :3])
    assert turned == pytest.approx(SHIFT[2], abs=1e-9)


def test_only_what_rests_on_it_moves_with_it() -> None:
    world = _world(which=0)
    cubes = SimulatedCell(read_cell(data_file("scenes/cell.toml")), world)._cubes
    cubes[3] = replace(cubes[3], where="jaws")
    board = world.boards[0]
    assert cubes_on(board, cubes) == (0, 1, 2)
    assert cubes_on(world.boards[1], cubes) == ()
    after, moved = with_shifted(world, cubes, board, board.T_shift)
    for before, now in zip(cubes[:3], moved[:3], strict=True):
        T = inverse(board.T_base_board) @ before.T_base_cube
        assert inverse(after.boards[0].T_base_board) @ now.T_base_cube == pytest.approx(T)
    assert moved[3] is cubes[3]
    assert after.boards[1] is world.boards[1]


def test_the_grasp_that_the_file_names_is_counted() -> None:
    world = _world(after=2)
    assert shifting_after(world, 1) == shifting_after(world, 3) == ()
    assert [b.board.name for b in shifting_after(world, 2)] == ["03-04"]


@pytest.mark.parametrize("after", [1, 2])
def test_a_grasp_of_a_cube_moves_the_board_once(after: int) -> None:
    simulated = SimulatedCell(read_cell(data_file("scenes/cell.toml")), _world(after))
    stood = simulated.world.boards[1].T_base_board
    unit, gripper = simulated.cell.unit, simulated.cell.unit.gripper
    T = simulated._cubes[0].T_base_cube @ transform(rot_x(np.pi), (0.0, 0.0, 0.003))
    q = inverse_kinematics(simulated.cell.robot(), T, unit.lower, unit.upper).q[0]
    counts = tuple(int(c) for c in unit.counts(q))
    moved = []
    for _ in range(3):
        simulated.jaws(counts, gripper.adc(0.0), gripper.adc(0.9))
        moved.append(not np.array_equal(simulated.world.boards[1].T_base_board, stood))
        simulated.jaws(counts, gripper.adc(1.0 / 3.0), gripper.adc(0.0))
    assert moved == [number >= after for number in (1, 2, 3)]
    motion = simulated.world.boards[1].T_base_board @ inverse(stood)
    assert motion == pytest.approx(_world().boards[1].T_shift, abs=1e-12)
