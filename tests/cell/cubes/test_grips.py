"""Grips of displaced cubes where there is little room, and lifts from beside another cube."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.robot.shapes import Body
from arm.se3 import Array, frozen, inverse, rot_z, transform
from cell.cubes.grips import HIGHER, LEANS, Grip, is_taken_from, recovery_grips
from cell.files.task import read_task
from cell.scene.bodies import T_hole_cube, cube_body
from cell.scene.build import hole_station
from cell.scene.displaced import DisplacedCube
from cell.sim.release_faults import T_hole_released
from tasks.true_look import true_look

TASK = read_task(data_file("scenes/task2.toml"))
CELL = TASK.cell
HOLE = true_look(TASK).boards[1].pose.holes[0]
T_HOLE = HOLE.T_base_hole
UP = T_HOLE[:3, 2]


def _grips(fault: str) -> tuple[DisplacedCube, list[Grip]]:
    cube = DisplacedCube(
        "cube 01-02/4", HOLE.name, frozen(mul(T_HOLE, T_hole_released(fault, CELL.cube_size)))
    )
    return cube, list(recovery_grips(CELL, cube, [hole_station(CELL, HOLE)], T_HOLE))


def _body(name: str, x: float, y: float = 0.0, yaw: float = 0.0) -> Body:
    """A cube that stands on the plate, at an offset from the hole's axis."""
    T = transform(rot_z(yaw), (x, y, CELL.cube_size / 2.0))
    return cube_body(name, CELL.cube_size, frozen(mul(T_HOLE, T)))


def _direction(degrees: float) -> Array:
    """Up from the plate, but leaning towards its x axis."""
    lean = np.radians(degrees)
    return np.asarray(mul(T_HOLE[:3, :3], np.array([np.sin(lean), 0.0, np.cos(lean)])))


@pytest.mark.parametrize("fault", ["rim", "aside", "high", "half"])
def test_every_grip_holds_the_cube_and_releases_it_where_a_straight_one_does(fault: str) -> None:
    cube, grips = _grips(fault)
    seat = mul(T_HOLE, T_hole_cube(CELL.cube_size))
    for grip in grips:
        (goal,) = grip.goals
        for T in grip.pick.T_base_tool:
            T_tool_cube = mul(inverse(T), cube.T_base_cube)
            assert np.abs(T_tool_cube[1, :3]).max() == pytest.approx(1.0)  # the jaws close on two faces
            assert T_tool_cube[:2, 3] == pytest.approx((0.0, 0.0), abs=1e-12)
        first = mul(inverse(grip.pick.T_base_tool[0]), cube.T_base_cube)
        for T in goal.T_base_tool:
            released = mul(T, first)
            assert released[:3, 2] == pytest.approx(seat[:3, 2], abs=1e-9)
            assert released[:3, 3] == pytest.approx(seat[:3, 3], abs=1e-9)


def test_a_straight_cube_is_also_taken_higher_and_by_a_tool_that_leans_to_each_side() -> None:
    cube, (straight, *others) = _grips("aside")
    usual = (inverse(straight.pick.T_base_tool[0]) @ cube.T_base_cube)[2, 3]
    leaning = [np.degrees(np.arccos(np.clip(-UP @ g.pick.T_base_tool[0][:3, 2], -1.0, 1.0))) for g in others]
    assert leaning == pytest.approx(np.abs(LEANS), abs=1e-5)
    for grip, lean in zip(others, LEANS, strict=True):
        for T in grip.pick.T_base_tool:
            assert (inverse(T) @ cube.T_base_cube)[2, 3] == pytest.approx(usual + HIGHER)
        sides = {tuple(np.round(T[:3, 2] + UP, 3)) for T in grip.pick.T_base_tool}
        assert len(sides) == (4 if lean else 1)


@pytest.mark.parametrize("yaw", np.radians([0.0, 20.0, 45.0, 70.0]))
@pytest.mark.parametrize("gap", [0.2e-3, 1e-3, 10e-3])
def test_a_cube_may_be_lifted_upwards_or_away_but_not_towards_another(yaw: float, gap: float) -> None:
    """However near it stands."""
    half = CELL.cube_size / 2.0
    cube, other = (
        _body("cube", half * (1.0 + np.cos(yaw) + np.sin(yaw)) + gap, 0.003, yaw),
        _body("other", 0.0),
    )
    assert is_taken_from(cube, other, _direction(0.0))
    assert is_taken_from(cube, other, _direction(20.0))
    assert not is_taken_from(cube, other, _direction(-20.0))
    assert is_taken_from(other, cube, _direction(-20.0))


def test_cubes_that_overlap_are_not_parted_by_a_lift() -> None:
    assert not is_taken_from(_body("cube", 0.039), _body("other", 0.0), UP)


def test_only_grips_whose_lift_parts_the_cubes_let_them_touch() -> None:
    cube, grips = _grips("rim")
    half = CELL.cube_size / 2.0
    body = cube_body(cube.name, CELL.cube_size, cube.T_base_cube)
    other = _body("cube 03-04/2", -half * (1.0 + np.sqrt(2.0)) - 1e-3)
    allowed = [grip.lifting_from(body, [other]) for grip in grips]
    for grip, lifting in zip(grips, allowed, strict=True):
        assert lifting is not None
        assert lifting.pick.touches == grip.pick.touches | {other.name}
        kept = [tuple(T.ravel()) for T in lifting.pick.T_base_tool]
        for T in grip.pick.T_base_tool:
            assert (tuple(T.ravel()) in kept) is bool(-T[:3, 2] @ T_HOLE[:3, 0] >= -np.sin(np.radians(1.0)))
    below = _body("cube 03-04/3", 0.030)
    assert all(grip.lifting_from(body, [other, below]) is None for grip in grips)
