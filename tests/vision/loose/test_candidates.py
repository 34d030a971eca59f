"""Squares of a cube's size are found at any yaw, whether brighter or darker than what is around them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from arm.se3 import Array, apply, rot_z, transform
from pictures.boards import CUBE, lab_camera
from vision.loose.candidates import candidates
from vision.occupancy.edge_response import PlateView, plate_view

T_BASE_TOP = transform(t=(0.45, -0.05, 0.04))


def _view(x: float, y: float, yaw: float, inside: int = 200, around: int = 120) -> PlateView:
    camera = lab_camera()
    image = np.full((camera.size[1], camera.size[0]), around, dtype=np.uint8)
    half = CUBE / 2.0
    corners: Array = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    pixels = camera.project_base(apply(T_BASE_TOP @ transform(rot_z(yaw), (x, y, 0.0)), corners))
    cv2.fillConvexPoly(image, np.rint(pixels).astype(np.int32), inside)
    view = plate_view([image], camera, T_BASE_TOP, 0.11)
    assert view is not None
    return view


@pytest.mark.parametrize("inside", [40, 200])
@pytest.mark.parametrize("yaw_deg", [0.0, 17.0, 43.0, 88.0])
def test_a_square_is_the_best_candidate(yaw_deg: float, inside: int) -> None:
    best = candidates(_view(0.021, -0.034, np.radians(yaw_deg), inside), CUBE, 0.06)[0]
    assert np.hypot(best.x - 0.021, best.y + 0.034) < 1.5e-3
    turn = (np.degrees(best.yaw) - yaw_deg + 45.0) % 90.0 - 45.0
    assert abs(turn) <= 3.0


def test_nothing_is_found_on_an_even_plate_or_beyond_the_distance() -> None:
    assert not candidates(_view(0.0, 0.0, 0.0, 120), CUBE, 0.06)
    near = candidates(_view(0.05, 0.0, 0.0), CUBE, 0.02)
    assert all(np.hypot(one.x, one.y) <= 0.02 + 1e-9 for one in near)
