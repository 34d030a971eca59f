"""Cubes in holes on rendered photographs: any grey, light, shadow, tilt, noise, and what the image does not say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.board import POCKET_MOUTH
from arm.poses import BoardPose
from arm.robot.shapes import Body, Box
from arm.se3 import Array, apply, transform
from pictures.boards import CUBE, lab_board, lab_camera, leaning, photograph, random_pose, smaller, window
from pictures.holes import (
    ACROSS,
    CONDITIONS,
    Conditions,
    drawn_pose,
    measured_pose,
    photographs,
    random_scene,
)
from vision.occupancy.classify import FAINT, LIGHT, NO_MARKER, OTHER, OUT, POSE, Occupancy, hole_occupancy

CAMERA = smaller(lab_camera(), 0.5)
KNOWN = np.diag([1e-4, 1e-4, 3e-4, 2e-3, 2e-3, 5e-4]) ** 2  # covariance of a good pose


def known(T_base_board: Array, name: str = "01-02") -> BoardPose:
    """The pose as if it had been measured."""
    return BoardPose(lab_board(name), T_base_board, KNOWN, 0.0, 1e3)


@pytest.mark.few(2)
@pytest.mark.parametrize("light", [0.35, 1.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 7.0, 15.0])
def test_cubes_and_empty_holes_are_told_apart(tilt_deg: float, light: float) -> None:
    for seed, name in enumerate(("01-02", "05-06")):
        rng = np.random.default_rng(seed)
        pose = known(random_pose(rng, tilt_deg), name)
        cubes = (rng.random(4) < 0.5).tolist()
        shot = photograph(
            CAMERA, [(pose.board, pose.T_base_board)], rng, cubes={name: cubes}, light=light, noise=4.0
        )
        seen = [hole_occupancy(shot.images, CAMERA, pose, i, CUBE) for i in range(4)]
        assert [o.state for o in seen] == ["cube" if c else "empty" for c in cubes]
        assert all(o.score > 0.8 if c else o.score < 0.2 for o, c in zip(seen, cubes, strict=True))


def judged(seed: int, of: Conditions) -> list[tuple[str, Occupancy]]:
    """What is true and what is said of the holes of a scene (see bench/occupancy.py, which judges 1200)."""
    scene = random_scene(seed, of, CAMERA)
    images = photographs(scene, CAMERA)
    pose = measured_pose(scene, images, CAMERA) or drawn_pose(scene)
    return [(true, hole_occupancy(images, CAMERA, pose, i, CUBE)) for i, true in enumerate(scene.holes)]


@pytest.mark.few(2)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_cubes_of_any_grey_under_any_light(condition: str) -> None:
    found = judged(40_000 + list(CONDITIONS).index(condition), CONDITIONS[condition])
    assert [o for true, o in found if o.state not in (true, "unsure")] == []
    assert sum(o.state == "unsure" for _, o in found) <= 1
    assert all(bool(o.reason) == (o.state == "unsure") for _, o in found)


@pytest.mark.slow
def test_what_is_no_cube_in_its_seat_is_neither_cube_nor_empty() -> None:
    found = [hole for seed in range(41_000, 41_004) for hole in judged(seed, ACROSS)]
    others = [o for true, o in found if true == "other"]
    assert [o for o in others if o.state != "unsure"] == []
    assert sum(o.reason == OTHER for o in others) >= 3
    assert [o for true, o in found if true != "other" and o.state not in (true, "unsure")] == []


@pytest.mark.few(1)
@pytest.mark.parametrize("grey", [12.0, 150.0, 240.0])
def test_the_light_does_not_say_what_is_in_a_hole(grey: float) -> None:
    """Empty pockets and cubes of one grey level each, right under the camera and at a slant."""
    for seed in (42_000, 42_001):
        for true, said in judged(seed, Conditions(cube_grey=(grey, grey), exposure=(0.7, 0.7))):
            assert said.state in (true, "unsure")
            assert said.state == true or said.reason == FAINT


def test_a_finger_hole_that_the_noise_hides_does_not_make_a_cube() -> None:
    for seed in range(3):
        pose = known(leaning((0.48, -0.015, 0.05), 20.0 + 90.0 * seed, 0.0, 0.0))
        board = [(pose.board, pose.T_base_board)]
        shot = photograph(CAMERA, board, np.random.default_rng(seed), light=0.2, noise=14.0)
        said = [hole_occupancy(shot.images, CAMERA, pose, i, CUBE) for i in range(4)]
        assert all(o.state != "cube" and o.score < 0.9 for o in said)


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


@pytest.mark.few(1)
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
    assert hole_occupancy(dark, CAMERA, pose, 0, CUBE) == Occupancy("unsure", 0.5, LIGHT)
    away = replace(pose, T_base_board=transform(t=(0.9, 0.0, 0.05)))
    light = photograph(CAMERA, board, rng).images
    assert hole_occupancy(light, CAMERA, pose, 1, CUBE).state == "empty"
    assert hole_occupancy(light, CAMERA, away, 0, CUBE) == Occupancy("unsure", 0.5, OUT)
    centres = apply(pose.T_base_board, pose.board.marker_corners().mean(axis=1))
    u = int(CAMERA.project_base(centres)[:, 0].min())  # an image that begins here cuts a marker in two
    cut = window(CAMERA, (u, 0), (CAMERA.size[0] - u, CAMERA.size[1]))
    said = hole_occupancy([i[:, u:].copy() for i in light], cut, pose, 1, CUBE)
    assert said.state == "empty"  # half a marker tells the light as well
    corner = np.rint(CAMERA.project_base(pose.holes[1].T_base_hole[:3, 3])).astype(int) - 90
    alone = window(CAMERA, corner, (180, 180))  # a hole, and no marker
    part = [i[corner[1] : corner[1] + 180, corner[0] : corner[0] + 180].copy() for i in light]
    assert hole_occupancy(part, alone, pose, 1, CUBE) == Occupancy("unsure", 0.5, NO_MARKER)


def test_a_pose_that_is_badly_known_makes_it_unsure() -> None:
    pose = known(leaning((0.44, -0.015, 0.05), 20.0, 15.0, 40.0))
    shot = photograph(
        CAMERA,
        [(pose.board, pose.T_base_board)],
        np.random.default_rng(3),
        cubes={pose.board.name: [True, False, True, False]},
    )
    for std in (
        np.array([1.5e-3, 1e-4, 1e-4, 1e-3, 1e-3, 1e-3]),
        np.array([1e-4, 1e-4, 1e-4, 0.05, 1e-3, 1e-3]),
    ):
        badly = replace(pose, covariance=np.diag(std**2))
        said = [hole_occupancy(shot.images, CAMERA, badly, i, CUBE) for i in range(4)]
        assert POSE in {o.reason for o in said}
        assert all(o.state in ("unsure", true) for o, true in zip(said, ["cube", "empty"] * 2, strict=True))
    nowhere = replace(pose, covariance=np.full((6, 6), np.nan))
    assert hole_occupancy(shot.images, CAMERA, nowhere, 0, CUBE) == Occupancy("unsure", 0.5, POSE)


def test_a_wrong_pose_does_not_make_cubes() -> None:
    """A pose that is off by more than it says: nothing is where it should be, so that nothing is sure to be wrong."""
    pose = known(leaning((0.44, -0.015, 0.05), 20.0, 7.0, 40.0))
    shot = photograph(
        CAMERA,
        [(pose.board, pose.T_base_board)],
        np.random.default_rng(4),
        cubes={pose.board.name: [True, False, True, False]},
    )
    for away in ((0.005, 0.0, 0.0), (0.0, -0.008, 0.0), (0.006, 0.006, 0.0)):
        off = replace(pose, T_base_board=pose.T_base_board @ transform(t=away))
        said = [hole_occupancy(shot.images, CAMERA, off, i, CUBE).state for i in range(4)]
        assert all(state in (true, "unsure") for state, true in zip(said, ["cube", "empty"] * 2, strict=True))
        assert "unsure" in said


@pytest.mark.parametrize("cube", [True, False])
def test_a_hole_that_the_edge_of_the_image_cuts_is_unsure(cube: bool) -> None:
    """All but 3 mm of the pocket is seen; what lies beyond the edge nobody knows."""
    pose = known(leaning((0.44, -0.015, 0.05), 20.0, 0.0, 0.0))
    cubes = {pose.board.name: [cube] * 4}
    image = photograph(
        CAMERA, [(pose.board, pose.T_base_board)], np.random.default_rng(5), cubes=cubes
    ).images[0]
    hole = pose.board.holes[3]
    half = POCKET_MOUTH / 2.0
    square = hole + [[x, y, 0.0] for x in (-half, half) for y in (-half, half)]
    rows = CAMERA.project_base(apply(pose.T_base_board, square))[:, 1]
    for cut_mm, states in ((-4.0, {"cube" if cube else "empty"}), (3.0, {"unsure"})):
        last = int(rows.max() - cut_mm * 1e-3 * CAMERA.K[1, 1] / 1.1)
        camera = window(CAMERA, (0, 0), (CAMERA.size[0], last))
        said = hole_occupancy([image[:last].copy()], camera, pose, 3, CUBE)
        assert said.state in states
        assert said.reason == ("" if cut_mm < 0.0 else OUT)


def test_the_turn_counts_where_the_top_of_a_cube_is() -> None:
    """A turn about the hole moves a cube's top; one about the top's place leaves it there."""
    pose = known(leaning((0.44, -0.015, 0.05), 20.0, 15.0, 40.0))
    shot = photograph(CAMERA, [(pose.board, pose.T_base_board)], np.random.default_rng(3))
    for about, doubted in (((0.0, 0.0, 0.0), True), ((0.0, 0.0, 0.032), False)):
        at = pose.board.holes[0] + about
        twist = np.array([0.05, 0.0, 0.0])  # rad about the board's x through that place
        column = np.concatenate([-np.cross(twist, at), twist])  # of the board's origin
        turned = replace(pose, covariance=np.outer(column, column) + 1e-12 * np.eye(6))
        said = hole_occupancy(shot.images, CAMERA, turned, 0, CUBE)
        assert (said.reason == POSE) is doubted
