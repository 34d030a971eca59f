"""A pose is recovered from exact sides, with its width and a covariance that says what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from arm.board import POCKET_FLOOR, POCKET_MOUTH
from arm.se3 import Array, frozen, inverse, rot_z, transform
from cell.sim.release_faults import T_hole_released
from pictures.boards import CUBE, lab_camera, leaning, twist_between
from vision.loose.fit import fit_pose, turned_to, with_yaw_near
from vision.loose.rests import Rest, rests, usual_normal
from vision.loose.sides import Sides, side_normals
from vision.occupancy.edge_response import PlateView, plate_view
from vision.occupancy.seated import CubeWidth

POCKET = (POCKET_MOUTH, POCKET_FLOOR)
T_BASE_HOLE = leaning((0.46, -0.13, 0.09), 90.0, 12.0, 200.0) @ transform(t=(0.06, 0.04, 0.0))
WIDTH = CubeWidth(CUBE, 2e-5)


def _view() -> PlateView:
    camera = lab_camera()
    image = np.zeros((camera.size[1], camera.size[0]), dtype=np.uint8)
    view = plate_view([image], camera, T_BASE_HOLE, 0.05)
    assert view is not None
    return view


def _sides(view: PlateView, T_base_cube: Array, std: float = 0.05) -> Sides:
    side, along = np.repeat(np.arange(4), 2), np.tile([-0.0085, 0.0085], 4)
    at, _ = side_normals(view, T_base_cube, CUBE, side, along)
    return Sides(side, frozen(along), frozen(at), frozen(np.full(8, std)), frozen(np.ones(4)), 0.0)


@pytest.mark.parametrize(("release", "kind"), [("aside", "flat"), ("rim", "flat"), ("half", "leaning")])
def test_exact_sides_give_the_pose_of_the_best_rest(release: str, kind: str) -> None:
    view, T = _view(), T_BASE_HOLE @ T_hole_released(release, CUBE)
    sides, fits = _sides(view, T), []
    for rest in rests(POCKET):
        start = turned_to(T, T_BASE_HOLE[:3, :3] @ usual_normal(rest), CUBE)
        fit = fit_pose(view, sides, rest, start, T_BASE_HOLE, WIDTH, POCKET)
        assert fit is not None
        fits.append(fit)
    best = min(fits, key=lambda fit: fit.worth)
    assert best.rest.kind == kind
    assert best.misfit < 1.0
    twist = twist_between(best.T_base_cube, T)
    assert np.linalg.norm(twist[:3]) < 3e-4
    assert np.degrees(np.linalg.norm(twist[3:])) < 0.3


def test_an_unknown_width_leaves_the_height_of_a_free_cube_unknown() -> None:
    view, T = _view(), T_BASE_HOLE @ T_hole_released("aside", CUBE)
    std = []
    for width in (1e-5, 1e-4):
        fit = fit_pose(view, _sides(view, T), Rest("free"), T, T_BASE_HOLE, CubeWidth(CUBE, width), POCKET)
        assert fit is not None
        std.append(float(np.sqrt(fit.covariance[2, 2])))
    assert std[0] < 1e-3 < 2e-3 < std[1]


def test_a_cube_is_turned_about_its_top_and_its_yaw_is_the_nearest() -> None:
    T = T_BASE_HOLE @ transform(rot_z(2.0), (0.01, 0.02, 0.02))
    normal = np.array([0.0, 0.0, 1.0])
    turned = turned_to(T, normal, CUBE)
    assert turned[:3, 2] == pytest.approx(normal, abs=1e-9)
    assert turned[:3, 3] + CUBE / 2.0 * normal == pytest.approx(T[:3, 3] + CUBE / 2.0 * T[:3, 2], abs=1e-12)
    near = inverse(T_BASE_HOLE) @ with_yaw_near(T, T_BASE_HOLE)
    assert abs(np.degrees(np.arctan2(near[1, 0], near[0, 0]))) <= 45.0
    assert near[:3, 3] == pytest.approx([0.01, 0.02, 0.02])
