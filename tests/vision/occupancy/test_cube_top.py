"""Sides of a cube's top: where they are likely, what passes for them, and what an empty place tells of them."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import POCKET_FLOOR, POCKET_MOUTH
from arm.robot.shapes import Body, Box
from arm.se3 import transform
from cell.scene.bodies import T_hole_cube, plate_body
from pictures.boards import CUBE, TABLE, lab_board, lab_camera, leaning, window
from pictures.placed import moved_cube
from render.light import Light
from render.renderer import PlacedBoard, render, with_noise
from render.solids import BodySolid
from vision.occupancy.cube_top import CubeTop
from vision.occupancy.seated import CubeWidth, Sight, seating, width_of

NOMINAL = CubeWidth(CUBE, 5e-5)


def _looks(
    grey: float, T_hole_cube_now: np.ndarray, light: float = 1.0, hole: int = 0
) -> tuple[Sight, Sight, np.ndarray]:
    """A hole with a cube of some grey, and the same hole before it; hole 3 is right under the camera."""
    board = lab_board("03-04")
    T_base_board = leaning((0.46, -0.13, 0.09), 90.0, 7.0, 270.0)
    T = T_base_board @ board.T_board_hole(hole)
    camera = lab_camera()
    camera = window(camera, np.round(camera.project_base(T[:3, 3][None])[0] - 200.0), (400, 400))
    rng = np.random.default_rng(5)
    sights = []
    for cubes, gain in ((1, light), (0, 1.0)):
        lamp = Light()
        others = [BodySolid(Body("cube", Box((CUBE,) * 3), T @ T_hole_cube_now, "cube"), lamp, grey)] * cubes
        clean = gain * render(
            camera,
            [TABLE, plate_body(board.name, T_base_board)],
            [PlacedBoard(board, T_base_board)],
            light=lamp,
            others=others,
        )
        images = [with_noise(clean.astype(np.float32), rng, 2.0) for _ in range(3)]
        sights.append(Sight(images, camera, NOMINAL, (POCKET_MOUTH, POCKET_FLOOR)))
    return sights[0], sights[1], T


def _std(top: CubeTop | None) -> float:
    width = width_of(top, NOMINAL)
    return np.inf if width is None else width.std


@pytest.mark.few(1)
@pytest.mark.parametrize("grey", [30.0, 60.0, 205.0])
def test_a_cube_of_any_grey_is_seated_and_measured_by_what_its_place_showed_empty(grey: float) -> None:
    sight, before, T = _looks(grey, T_hole_cube(CUBE), light=1.04)
    with_it = sight.in_hole(T, before.empty(T))
    known = CubeWidth(CUBE, 1e-5)
    assert seating(with_it, known).state == "seated"
    assert abs(seating(with_it, known).lift) < 1.5e-3
    assert _std(with_it) < 3e-5


@pytest.mark.slow
@pytest.mark.parametrize("grey", [pytest.param(30.0, marks=pytest.mark.slow), 205.0])
def test_a_cube_four_millimetres_high_is_told_with_and_without_an_empty_place(grey: float) -> None:
    sight, before, T = _looks(grey, transform(t=(0.0, 0.0, 4e-3)) @ T_hole_cube(CUBE), light=0.97)
    found = seating(sight.in_hole(T, before.empty(T)), CubeWidth(CUBE, 1e-5))
    assert found.state != "seated"
    assert found.lift == pytest.approx(4e-3, abs=3.0 * found.lift_std)
    assert seating(sight.in_hole(T), CubeWidth(CUBE, 1e-5)).state != "seated"


@pytest.mark.slow
def test_an_empty_hole_shows_no_seated_cube() -> None:
    _, before, T = _looks(100.0, T_hole_cube(CUBE))
    assert seating(before.in_hole(T, before.empty(T)), CubeWidth(CUBE, 1e-5)).state != "seated"
    assert seating(before.in_hole(T), CubeWidth(CUBE, 1e-5)).state != "seated"


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "where"), [(400114, "view"), (400090, "view"), (400107, "edge")])
def test_a_turned_cube_beside_narrow_faces_and_borders_is_confirmed_as_it_is(seed: int, where: str) -> None:
    """Its faces are 0.1 to 0.6 mm wide in the image, and the board's own border ends where its side is."""
    case = moved_cube(seed, "seated", lab_camera(), where, grey=(25.0, 170.0))
    before, after = case.target, case.target_after
    assert before.pose is not None
    assert after.pose is not None
    empty = Sight(before.images, before.camera, NOMINAL).empty(before.pose.holes[before.index].T_base_hole)
    sight = Sight(after.images, after.camera, NOMINAL)
    top = sight.in_hole(after.pose.holes[after.index].T_base_hole, empty)
    found = seating(top, CubeWidth(case.size, 1e-5))
    assert found.state == "seated", found
    assert abs(found.lift) < 3.0 * found.lift_std


@pytest.mark.slow
def test_the_pocket_is_the_cells_own() -> None:
    """A cube that wedges 1 mm less deep in a narrower pocket sits there, and stands high in the usual one."""
    sight, before, T = _looks(205.0, transform(t=(0.0, 0.0, 1e-3)) @ T_hole_cube(CUBE))
    narrow = Sight(sight.images, sight.camera, NOMINAL, (0.0435, 0.0385))
    lifts = [seating(s.in_hole(T, before.empty(T)), CubeWidth(CUBE, 1e-5)).lift for s in (sight, narrow)]
    assert lifts[0] - lifts[1] == pytest.approx(1e-3, abs=0.4e-3)


def test_a_side_beyond_the_image_is_no_top() -> None:
    sight, _, T = _looks(205.0, T_hole_cube(CUBE))
    corner = sight.camera.project_base(T[:3, 3][None])[0]
    small = window(sight.camera, np.round(corner - 60.0), (120, 120))
    low = np.round(corner - 60.0).astype(int)
    images = [image[low[1] : low[1] + 120, low[0] : low[0] + 120] for image in sight.images]
    assert Sight(images, small, NOMINAL).in_hole(T) is None
