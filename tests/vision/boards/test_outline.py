"""Sides of a board's outline: where they are in drawn pictures, and what hides them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from arm.robot.shapes import Body, Box
from arm.se3 import Array, inverse, transform
from outlined.puzzle import PLAIN, PUZZLE, as_designed, corners_of, lying, picture, view_of
from vision.boards.outline import SIDES, Side, find_sides, meet
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.edge_profiles import Grey

T = lying((0.46, 0.02, 0.034), 30.0, 6.0, 80.0)
CAMERA = view_of(corners_of(T))
T_CAMERA = inverse(CAMERA.T_base_camera) @ T
OFF = transform(t=(8e-4, -6e-4, 2e-3))  # a pose to begin with: sides appear up to 1 mm off


@lru_cache(maxsize=2)
def drawn(hidden: bool = False) -> Grey:
    """A picture of the board, if asked with a bar over its right side, from 0.2 to 0.9 of its length."""
    bar = Body("bar", Box((0.03, 0.088, 0.002)), T @ transform(t=(0.1, -0.044, 0.004)), "wire")
    bodies = [bar] if hidden else []
    image = picture(CAMERA, [(as_designed(), T)], PLAIN, np.random.default_rng(0), bodies)
    return np.asarray(image, dtype=np.float32)


def across(side: Side, T_camera_board: Array = T_CAMERA, camera: Camera = CAMERA) -> Array:
    """Distance of a side's line from where a pose puts it, (2,) px."""
    seen = Projection(camera, T_camera_board, side.points).pixels
    return np.asarray((side.inwards * (side.found_px - seen)).sum(axis=-1))


def test_all_sides_are_found_where_they_are() -> None:
    sides = find_sides(drawn(), PUZZLE, T_CAMERA @ OFF, CAMERA, 3e-3)
    assert [side.index for side in sides] == [0, 1, 2, 3]
    assert min(side.seen for side in sides) > 0.9
    assert max(np.abs(across(side)).max() for side in sides) < 0.15
    assert max(float(np.sqrt(side.noise.max())) for side in sides) < 0.05
    for side in sides:  # inwards is towards the middle of the board
        middle = Projection(CAMERA, T_CAMERA, np.array([[*PUZZLE.plate.centre, 0.0]])).pixels
        assert ((side.inwards * (middle - side.found_px)).sum(axis=-1) > 100.0).all()


def test_a_hidden_part_neither_counts_nor_draws_the_line() -> None:
    free, hidden = (find_sides(drawn(h), PUZZLE, T_CAMERA @ OFF, CAMERA, 3e-3) for h in (False, True))
    assert [side.confirms for side in free] == [True] * 4
    right = next((side for side in hidden if SIDES[side.index] == "right"), None)
    assert right is None or not right.confirms
    if right is not None:
        assert np.abs(across(right)).max() < 0.6
    assert [side.confirms for side in hidden if SIDES[side.index] != "right"] == [True] * 3


def test_sides_beyond_the_reach_are_not_found() -> None:
    far = T_CAMERA @ transform(t=(6e-3, 6e-3, 0.0))
    assert not any(side.confirms for side in find_sides(drawn(), PUZZLE, far, CAMERA, 2e-3))


def test_sides_where_the_lens_is_not_calibrated_do_not_count() -> None:
    middle = Projection(CAMERA, T_CAMERA, np.array([[*PUZZLE.plate.centre, 0.0]])).pixels[0]
    half = replace(CAMERA, region=(0.0, 0.0, float(middle[0]), float(CAMERA.size[1])))
    sides = find_sides(drawn(), PUZZLE, T_CAMERA, half, 3e-3)
    assert 0 < sum(side.confirms for side in sides) < 4
    for side in (s for s in sides if s.confirms):
        assert (side.found_px[:, 0] <= middle[0]).all()


def test_opposite_sides_do_not_meet_and_boards_without_an_outline_have_none() -> None:
    sides = find_sides(drawn(), PUZZLE, T_CAMERA, CAMERA, 3e-3)
    assert meet(sides)
    assert meet(sides[:2])
    assert not meet(sides[::2])
    assert not meet([])
    assert find_sides(drawn(), replace(PUZZLE, outline=None), T_CAMERA, CAMERA, 3e-3) == []
