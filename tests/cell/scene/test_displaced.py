"""A cube beside its seat: where the jaws grip it, and what its place tells of its release."""

from __future__ import annotations

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.se3 import apply, frozen, inverse, rot_x, rot_z, rotation, transform
from cell.files.task import read_task
from cell.scene.bodies import T_hole_cube
from cell.scene.build import build_scene, hole_station
from cell.scene.displaced import DisplacedCube, is_displaced, is_hidden, shifted, support_of, with_displaced
from cell.sim.release_faults import T_hole_released
from tasks.true_look import true_look
from vision.occupancy.classify import OTHER, OUT, Occupancy

TASK = read_task(data_file("scenes/task2.toml"))
SEEN = true_look(TASK)
HOLE = SEEN.boards[1].pose.holes[0]


def _beside(T_hole_cube_now: np.ndarray) -> DisplacedCube:
    return DisplacedCube("cube 01-02/4", HOLE.name, frozen(mul(HOLE.T_base_hole, T_hole_cube_now)))


def test_a_seated_cube_is_gripped_as_its_hole_says() -> None:
    cell = TASK.cell
    station, hole = _beside(T_hole_cube(cell.cube_size)).station(cell), hole_station(cell, HOLE)
    assert np.allclose(station.T_base_tool, hole.T_base_tool, atol=1e-12)
    assert station.touches == hole.touches
    assert station.name == f"beside {HOLE.name}"


@pytest.mark.parametrize("seed", range(5))
def test_the_jaws_grip_a_cube_as_it_stands(seed: int) -> None:
    """Wherever it is, its middle lies between the fingers, aligned with them, as deep as in a seated grip."""
    rng, size = np.random.default_rng(seed), TASK.cell.cube_size
    T = transform(
        mul(rot_z(rng.uniform(-np.pi, np.pi)), rot_x(rng.uniform(-0.2, 0.2))), rng.uniform(-0.03, 0.03, 3)
    )
    cube = _beside(T)
    seated = inverse(hole_station(TASK.cell, HOLE).T_base_tool[0]) @ HOLE.T_base_hole @ T_hole_cube(size)
    for T_base_tool in cube.station(TASK.cell).T_base_tool:
        T_tool_cube = inverse(T_base_tool) @ cube.T_base_cube
        assert np.allclose(T_tool_cube[:3, 3], seated[:3, 3], atol=1e-12)
        assert np.allclose(np.abs(T_tool_cube[2, :3]), (0.0, 0.0, 1.0), atol=1e-12)
        assert np.allclose(np.sort(np.abs(T_tool_cube[:2, :2]).ravel()), (0.0, 0.0, 1.0, 1.0), atol=1e-12)


def test_a_leaning_cube_tells_by_its_bottom_where_it_was_released() -> None:
    size = TASK.cell.cube_size
    leaning = _beside(T_hole_released("half", size))
    centre = apply(inverse(HOLE.T_base_hole), leaning.T_base_cube[:3, 3])
    assert np.hypot(*centre[:2]) > 2.5e-3
    assert np.hypot(*leaning.offset(TASK.cell, HOLE.T_base_hole)) < 0.3e-3
    assert leaning.release_offset(TASK.cell, HOLE.T_base_hole) is not None
    aside = _beside(T_hole_released("aside", size))
    assert aside.offset(TASK.cell, HOLE.T_base_hole) == pytest.approx((0.025, 0.0))
    assert aside.describe(TASK.cell, HOLE.T_base_hole) == (
        f"25.0 mm from {HOLE.name}, rotated by 0 deg, tilted by 0.0 deg"
    )
    turned = _beside(T_hole_released("rim", size)).describe(TASK.cell, HOLE.T_base_hole)
    assert "rotated by 45 deg" in turned


@pytest.mark.parametrize("std", [0.0, 1e-3])
def test_a_cube_of_uncertain_height_is_released_higher(std: float) -> None:
    """It may be lower in the jaws than it seems, and would be pressed into its seat."""
    station = hole_station(TASK.cell, HOLE, 1e-3)
    goal = DisplacedCube("cube 01-02/4", HOLE.name, HOLE.T_base_hole, std).goal(station)
    for T, T_raised in zip(station.T_base_tool, goal.T_base_tool, strict=True):
        assert T_raised[:3, 3] - T[:3, 3] == pytest.approx(2.0 * std * HOLE.T_base_hole[:3, 2])
        assert np.allclose(T_raised[:3, :3], T[:3, :3])
    assert (goal.name, goal.touches) == (station.name, station.touches)


CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
# poses of cubes after releases in contact physics: offset in mm and its direction in deg, centre, normal of the top
JAMMED = (
    (3.18, 180.0, (-4.50, -0.15, 16.23), (0.243, 0.0, 0.970), 0.5),
    (4.36, -67.7, (-0.30, -4.64, 16.26), (0.0, 0.244, 0.970), -0.9),
    (2.69, 103.8, (-0.42, 3.56, 16.12), (-0.002, -0.238, 0.971), 1.1),
    (3.02, -131.7, (-0.80, -1.78, 15.86), (0.0, 0.225, 0.974), -2.3),
    (2.56, -5.3, (3.37, -0.04, 16.10), (-0.234, 0.001, 0.972), -0.2),
    (3.90, 40.7, (-0.57, 1.70, 15.98), (-0.009, -0.228, 0.974), 1.1),
    (3.18, 0.0, (1.21, 0.01, 15.86), (-0.218, 0.0, 0.976), 0.0),
)


@pytest.mark.parametrize(("off", "towards", "centre", "normal", "yaw"), JAMMED)
def test_a_jammed_cube_tells_the_direction_of_its_release(
    off: float, towards: float, centre: tuple[float, ...], normal: tuple[float, ...], yaw: float
) -> None:
    """What remains along the axis of the jam after the correction is within the capture of 2 mm."""
    axis = np.cross((0.0, 0.0, 1.0), normal)
    R = rotation(axis / np.linalg.norm(axis) * np.arcsin(np.linalg.norm(axis))) @ rot_z(np.radians(yaw))
    found = _beside(transform(R, 1e-3 * np.array(centre))).release_offset(TASK.cell, HOLE.T_base_hole)
    assert found is not None
    (jammed,) = np.flatnonzero(found)
    released = 1e-3 * off * np.array([np.cos(np.radians(towards)), np.sin(np.radians(towards))])
    assert abs(released[jammed] - found[jammed]) < 1.5e-3


@pytest.mark.parametrize(("fault", "known"), [("rim", False), ("aside", False), ("high", True)])
def test_only_an_upright_cube_that_was_not_pushed_stands_where_it_was_released(
    fault: str, known: bool
) -> None:
    cube = _beside(T_hole_released(fault, TASK.cell.cube_size))
    assert (cube.release_offset(TASK.cell, HOLE.T_base_hole) is not None) is known


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("quarter", range(4))
def test_jaws_may_lean_less_than_a_cube_whose_faces_they_still_hold(share: float, quarter: int) -> None:
    """Moved as T_tool_leaning says at the target, too, they release it straight."""
    cell, turn = TASK.cell, transform(rot_z(quarter * np.pi / 2))
    cube = _beside(mul(turn, T_hole_released("half", cell.cube_size)))
    straight, grips = cube.station(cell), cube.tilted_grips(cell, HOLE.T_base_hole, share)
    assert len(grips) == 2
    for station, T_tool_leaning in grips:
        (T,) = station.T_base_tool
        T_tool_cube = inverse(T) @ cube.T_base_cube
        assert np.abs(T_tool_cube[1, :3]).max() == pytest.approx(1.0)  # the jaws close on two faces
        tilt = np.arccos(np.clip(-T[:3, 2] @ HOLE.T_base_hole[:3, 2], -1.0, 1.0))
        assert np.degrees(tilt) == pytest.approx(8.0 * (1.0 - share), abs=1e-5)
        assert abs(T_tool_cube[1, 3]) < 1e-12  # between them
        highest = min((T_tool_cube @ (*corner, 1.0))[2] for corner in cell.cube_size / 2 * CORNERS)
        seated = (inverse(straight.T_base_tool[0]) @ cube.T_base_cube)[2, 3] - cell.cube_size / 2
        assert highest > seated - 0.2e-3  # of its corners, as far from the palm as in a straight grip
        goal = hole_station(cell, HOLE).T_base_tool[1]
        released = goal @ T_tool_leaning @ T_tool_cube
        assert released[:3, :3].T @ HOLE.T_base_hole[:3, 2] == pytest.approx((0.0, 0.0, 1.0), abs=1e-9)
        assert np.allclose(
            released[:3, 3], (HOLE.T_base_hole @ T_hole_cube(cell.cube_size))[:3, 3], atol=1e-9
        )


def test_a_straight_cube_needs_no_tilted_grips() -> None:
    assert (
        _beside(T_hole_released("rim", TASK.cell.cube_size)).tilted_grips(TASK.cell, HOLE.T_base_hole, 1.0)
        == []
    )


def test_a_scene_holds_displaced_cubes_as_obstacles_that_touch_what_they_stand_on() -> None:
    cube = _beside(T_hole_released("aside", TASK.cell.cube_size))
    scene = with_displaced(TASK.cell, build_scene(TASK.cell, SEEN.with_states({"01-02/4": "empty"})), (cube,))
    body = scene.cube("cube 01-02/4")
    assert np.allclose(body.T_base_body, cube.T_base_cube)
    assert body.padding == TASK.cell.moved
    assert frozenset((cube.name, support_of(HOLE.name))) in scene.allowed


def test_what_supports_a_cube_is_known_by_its_place() -> None:
    assert support_of("03-04/1") == support_of("beside 03-04/1") == "plate 03-04"
    assert support_of("table/2") == support_of("beside table/2") == "table"


def test_only_a_hole_that_shows_something_else_holds_a_displaced_cube() -> None:
    assert is_displaced(Occupancy("unsure", 0.5, OTHER))
    assert not is_displaced(Occupancy("unsure", 0.5, OUT))
    assert not is_displaced(Occupancy("unsure"))
    assert not is_displaced(Occupancy("cube"))


def test_a_displaced_cube_hides_the_unsure_holes_around_it_alone() -> None:
    cube = _beside(T_hole_released("aside", TASK.cell.cube_size))
    far = max(
        SEEN.boards[1].pose.holes, key=lambda hole: np.hypot(*(hole.T_base_hole - HOLE.T_base_hole)[:2, 3])
    )
    unsure = Occupancy("unsure", 0.5, OTHER)
    assert is_hidden(HOLE, unsure, [cube])
    assert not is_hidden(HOLE, Occupancy("cube"), [cube])
    assert not is_hidden(far, unsure, [cube])
    assert not is_hidden(HOLE, unsure, [])


def test_a_shift_is_in_the_plane_of_the_place() -> None:
    T = inverse(HOLE.T_base_hole) @ hole_station(TASK.cell, HOLE).T_base_tool[1]
    moved = inverse(HOLE.T_base_hole) @ shifted(
        HOLE.T_base_hole @ T, HOLE.T_base_hole, np.array([1e-3, -2e-3])
    )
    assert np.allclose(moved[:3, :3], T[:3, :3], atol=1e-12)
    assert np.allclose(moved[:3, 3] - T[:3, 3], (1e-3, -2e-3, 0.0), atol=1e-12)
