"""Cubes in holes on rendered photographs: light, tilt, noise, and what the image does not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.bodies import Body, Box
from arm.poses import BoardPose
from arm.se3 import Array, apply, transform
from board_scenes import CUBE, lab_board, lab_camera, leaning, photograph, random_pose, smaller, window
from vision.occupancy import hole_occupancy

CAMERA = smaller(lab_camera(), 0.5)


def known(T_base_board: Array, name: str = "01-02") -> BoardPose:
    """The pose as if it had been measured."""
    return BoardPose(lab_board(name), T_base_board, np.eye(6), 0.0, 1e3)


@pytest.mark.parametrize("light", [0.35, 1.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 7.0, 15.0])
def test_cubes_and_empty_holes_are_told_apart(tilt_deg: float, light: float) -> None:
    for seed, name in enumerate(("01-02", "05-06", "09-10")):
        rng = np.random.default_rng(seed)
        pose = known(random_pose(rng, tilt_deg), name)
        cubes = (rng.random(4) < 0.5).tolist()
        shot = photograph(
            CAMERA, [(pose.board, pose.T_base_board)], rng, cubes={name: cubes}, light=light, noise=4.0
        )
        seen = [hole_occupancy(shot.images, CAMERA, pose, i, CUBE) for i in range(4)]
        assert [o.state for o in seen] == ["cube" if c else "empty" for c in cubes]
        assert all(o.score > 0.8 if c else o.score < 0.2 for o, c in zip(seen, cubes, strict=True))


def covered(pose: BoardPose, hole: int, at: tuple[float, float, float], cube: bool, kind: str) -> str:
    """What is said of a hole with a plate held over a part of it, `at` metres from the hole in the board frame."""
    T = pose.T_base_board @ pose.board.T_board_hole(hole) @ transform(t=at)
    cubes = {pose.board.name: [cube and i == hole for i in range(4)]}
    shot = photograph(
        CAMERA,
        [(pose.board, pose.T_base_board)],
        np.random.default_rng(0),
        cubes=cubes,
        bodies=[Body("plate", Box((0.04, 0.06, 0.003)), T, kind)],
    )
    return hole_occupancy(shot.images, CAMERA, pose, hole, CUBE).state


@pytest.mark.parametrize("cube", [True, False])
def test_something_across_a_hole_makes_it_unsure(cube: bool) -> None:
    pose = known(leaning((0.44, -0.015, 0.05), 20.0, 0.0, 0.0))
    assert covered(pose, 1, (0.5, 0.5, 0.06), cube, "wall") == ("cube" if cube else "empty")
    assert covered(pose, 1, (0.022, 0.0, 0.06), True, "wall") == "unsure"
    assert covered(pose, 1, (0.029, 0.0, 0.06), True, "wall") == "unsure"  # most of the cube's top is seen
    assert covered(pose, 1, (0.022, 0.0, 0.06), False, "robot") == "unsure"


def test_no_light_or_out_of_view_is_unsure() -> None:
    rng = np.random.default_rng(1)
    pose = known(random_pose(rng, 7.0))
    board = [(pose.board, pose.T_base_board)]
    dark = photograph(CAMERA, board, rng, light=0.05).images
    assert hole_occupancy(dark, CAMERA, pose, 0, CUBE).state == "unsure"
    away = replace(pose, T_base_board=transform(t=(0.9, 0.0, 0.05)))
    light = photograph(CAMERA, board, rng).images
    assert hole_occupancy(light, CAMERA, pose, 1, CUBE).state == "empty"
    assert hole_occupancy(light, CAMERA, away, 0, CUBE).state == "unsure"
    centres = apply(pose.T_base_board, pose.board.marker_corners().mean(axis=1))
    u = int(CAMERA.project_base(centres)[:, 0].min())  # an image that begins here cuts a marker in two
    cut = window(CAMERA, (u, 0), (CAMERA.size[0] - u, CAMERA.size[1]))
    assert hole_occupancy([i[:, u:].copy() for i in light], cut, pose, 1, CUBE).state == "unsure"
