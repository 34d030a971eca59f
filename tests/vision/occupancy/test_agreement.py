"""Images of one look that show different states of a hole, and clean ones that never do."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from arm.poses import BoardPose
from pictures.boards import CUBE, lab_board, lab_camera, photograph, random_pose, smaller
from pictures.holes import CONDITIONS, drawn_pose, measured_pose, photographs, random_scene
from vision.camera.model import Image
from vision.occupancy.agreement import agreed_occupancy
from vision.occupancy.classify import Occupancy, hole_occupancy

CAMERA = smaller(lab_camera(), 0.5)
KNOWN = np.diag([1e-4, 1e-4, 3e-4, 2e-3, 2e-3, 5e-4]) ** 2  # covariance of a good pose


@lru_cache(maxsize=1)
def with_and_without() -> tuple[BoardPose, list[Image], list[Image]]:
    """A board with a cube in its first hole, and the same without it."""
    T, board, found = random_pose(np.random.default_rng(7), 7.0), lab_board(), list[list[Image]]()
    for first in (True, False):
        cubes = {board.name: [first, True, False, True]}
        shot = photograph(CAMERA, [(board, T)], np.random.default_rng(8), count=5, cubes=cubes, noise=4.0)
        found.append(list(shot.images))
    return BoardPose(board, T, KNOWN, 0.0, 1e3), *found


@pytest.mark.parametrize(
    ("pattern", "why"),
    [
        ("ccnnn", "of 5 images a cube is in 1 and 2, and none in 3, 4 and 5: they must be of one moment"),
        ("nnnnc", "of 5 images a cube is in 5, and none in 1, 2, 3 and 4: they must be of one moment"),
        ("cn", "of 2 images a cube is in 1, and none in 2: they must be of one moment"),
    ],
)
def test_images_that_disagree_about_a_hole_make_it_unsure(pattern: str, why: str) -> None:
    pose, with_cube, without = with_and_without()
    images = [(with_cube if which == "c" else without)[i] for i, which in enumerate(pattern)]
    found = [agreed_occupancy(images, CAMERA, pose, i, CUBE) for i in range(4)]
    assert found[0] == Occupancy("unsure", 0.5, why)
    assert [one.state for one in found[1:]] == ["cube", "empty", "cube"]


def test_a_change_of_exposure_is_none_of_the_hole() -> None:
    pose, images, _ = with_and_without()
    factors = (1.0, 0.8)
    darker = [np.asarray(np.rint(f * i), dtype=np.uint8) for f, i in zip(factors, images, strict=False)]
    assert [agreed_occupancy(darker, CAMERA, pose, i, CUBE).state for i in range(4)] == [
        *("cube", "cube", "empty", "cube")
    ]


@pytest.mark.few(2)
@pytest.mark.parametrize("condition", ["cubes as the plate", "low light", "noise"])
def test_a_mixture_is_told_of_cubes_of_any_grey(condition: str) -> None:
    scene = random_scene(52_001, CONDITIONS[condition], CAMERA)
    without = replace(scene, things=tuple(thing for thing in scene.things if thing[0].kind != "cube"))
    images = [*photographs(scene, CAMERA), *photographs(without, CAMERA)[:1]]
    pose = measured_pose(scene, images[:2], CAMERA) or drawn_pose(scene)
    for index, true in enumerate(scene.holes):
        found = agreed_occupancy(images, CAMERA, pose, index, CUBE)
        alone = [hole_occupancy([image], CAMERA, pose, index, CUBE).state for image in images]
        assert ("of one moment" in found.reason) == (alone[0] == "cube" or alone[1] == "cube")
        assert true == "cube" or found.state != "cube"


@pytest.mark.few(4)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_clean_images_are_judged_together(condition: str) -> None:
    """Cubes of any grey in any light, with noise: as before, and never of different moments."""
    for seed in range(3):
        scene = random_scene(50_000 + seed, CONDITIONS[condition], CAMERA)
        images = photographs(scene, CAMERA)
        pose = measured_pose(scene, images, CAMERA) or drawn_pose(scene)
        for index in range(4):
            assert agreed_occupancy(images, CAMERA, pose, index, CUBE) == hole_occupancy(
                images, CAMERA, pose, index, CUBE
            )
