"""The sides of a cube's top are measured to a tenth of a pixel, and sides that do not show are said not to."""

from __future__ import annotations

import numpy as np
import pytest

from arm.robot.shapes import Body, Box
from arm.se3 import Array, rot_z, transform
from pictures.boards import CUBE, TABLE, lab_camera, window
from render.renderer import render, with_noise
from vision.loose.sides import OUTWARD, measure_sides, side_normals
from vision.occupancy.edge_response import PlateView, plate_view

T_BASE_CUBE = transform(rot_z(0.4), (0.45, -0.15, CUBE / 2.0))


def _view(*others: Body) -> PlateView:
    camera = lab_camera()
    at = camera.project_base(T_BASE_CUBE[:3, 3][None])[0]
    camera = window(camera, np.round(at - 180.0), (360, 360))
    cube = Body("cube", Box((CUBE,) * 3), T_BASE_CUBE, "cube")
    image = with_noise(
        render(camera, [TABLE, cube, *others], [], "DICT_4X4_50"), np.random.default_rng(2), 2.0
    )
    view = plate_view([image], camera, T_BASE_CUBE @ transform(t=(0.0, 0.0, CUBE / 2.0)), 0.06)
    assert view is not None
    return view


def _off(view: PlateView, T: Array, reach: float, exact: bool) -> tuple[Array, Array, Array]:
    """Distances of the measured sides from the true ones, px, their standard deviations, and what is shown."""
    sides = measure_sides(view, T, CUBE, reach, view.noise(), exact)
    # the points were measured on a shifted pose: compare with the true line through the nearest point
    at, normal = side_normals(view, T_BASE_CUBE, CUBE, sides.side, sides.along)
    return np.sum((sides.points - at) * normal, axis=1), sides.std, sides.shown


@pytest.mark.parametrize(("reach", "exact"), [(3.5, True), (3.5, False), (11.0, False)])
def test_sides_are_where_they_are_from_a_pose_that_is_off(reach: float, exact: bool) -> None:
    shift = 1e-4 if exact else 1.5e-4 * reach
    T = T_BASE_CUBE @ transform(rot_z(np.radians(0.3)), (shift, -shift, 0.0))
    off, std, shown = _off(_view(), T, reach, exact)
    assert len(off) == 8
    assert (shown > 0.9).all()
    assert np.abs(off).max() < 0.12
    assert (np.abs(off) < 3.0 * std).all()


def test_a_side_that_something_hides_is_not_shown() -> None:
    """A block as bright as the cube stands on its top's side."""
    at = T_BASE_CUBE @ transform(t=(*(OUTWARD[1] * CUBE / 2.0), CUBE / 2.0 + 2e-3))
    block = Body("block", Box((0.02, CUBE + 0.02, 4e-3)), at, "cube")
    _, _, shown = _off(_view(block), T_BASE_CUBE, 3.5, False)
    assert shown[1] == 0.0
    assert shown[3] > 0.9


def test_the_first_step_outwards_is_the_side() -> None:
    """A strip beside the top, at its height, has steps as large."""
    beside = CUBE / 2.0 + 1.8e-3 + 2e-3
    at = T_BASE_CUBE @ transform(t=(*(OUTWARD[1] * beside), CUBE / 2.0 - 0.5e-3))
    strip = Body("strip", Box((4e-3, CUBE, 1e-3)), at, "cube")
    off, _, shown = _off(_view(strip), T_BASE_CUBE, 11.0, False)
    assert (shown > 0.9).all()
    assert np.abs(off).max() < 0.3
