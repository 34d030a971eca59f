"""Looks at boards that stand elsewhere: what is seen more exactly there, and where a board may not stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from arm.numerics.products import mul
from arm.poses import BoardPose
from arm.se3 import Array, frozen, inverse, transform
from cell.accuracy.board_moves import moved_look, nearer_looks
from cell.config.cell import Cell
from cell.files.task import Task
from vision.camera.projection import Projection
from vision.observation import Observation

NAMES = ("01-02", "03-04")
UP = np.array([0.0, 0.0, 0.03])


def _noise(cell: Cell, pose: BoardPose, sigma_px: float) -> Array:
    """Covariance of a board's twist if all pixels of its corners have independent errors."""
    T_camera_board = mul(inverse(cell.camera.T_base_camera), pose.T_base_board)
    corners = pose.board.marker_corners().reshape(-1, 3)
    J = Projection(cell.camera.at(np.eye(4)), T_camera_board, corners).by_target.reshape(-1, 6)
    return np.asarray(sigma_px**2 * np.linalg.inv(J.T @ J))


def _noisy(cell: Cell, seen: Observation, rest: Array) -> Observation:
    def pose(of: BoardPose) -> BoardPose:
        noise = _noise(cell, of, 0.3)
        return replace(of, covariance=frozen(noise + rest), repeatability=frozen(noise))

    return replace(seen, boards=tuple(replace(b, pose=pose(b.pose)) for b in seen.boards))


def test_equal_pixels_give_the_covariance_of_the_new_place(task: Task, seen: Observation) -> None:
    rest = np.diag([1e-8] * 3 + [1e-7] * 3)
    before = _noisy(task.cell, seen, rest)
    look = moved_look(task.cell, before, NAMES, UP)
    assert look is not None
    for was, now in zip(before.poses, look.poses, strict=True):
        assert np.allclose(now.T_base_board, transform(t=UP) @ was.T_base_board)
        expected = _noise(task.cell, now, 0.3)
        assert now.repeatability is not None
        assert np.allclose(now.repeatability, expected, rtol=1e-6, atol=0.0)
        assert np.allclose(now.covariance - now.repeatability, rest, atol=1e-12)
        assert was.repeatability is not None
        height = [float(of[2, 2]) for of in (was.repeatability, now.repeatability)]
        assert height[1] < 0.95 * height[0]  # nearer to the camera


def test_noise_that_is_not_known_stays(task: Task, seen: Observation) -> None:
    look = moved_look(task.cell, seen, NAMES, UP)
    assert look is not None
    assert all(pose.repeatability is None for pose in look.poses)
    assert all(
        np.array_equal(was.covariance, now.covariance)
        for was, now in zip(seen.poses, look.poses, strict=True)
    )


def test_boards_stay_in_their_zone_in_the_image_and_apart(task: Task, seen: Observation) -> None:
    cell = task.cell
    assert moved_look(cell, seen, NAMES, np.array([-0.03, 0.0, 0.0])) is not None
    assert moved_look(cell, seen, NAMES, np.array([-0.12, 0.0, 0.0])) is None  # the zone ends at x = 250 mm
    assert moved_look(cell, seen, NAMES, np.array([0.0, 0.0, 0.11])) is None  # and at 218 mm
    wide = replace(cell, zone=cell.zone.at(transform(t=(0.47, -0.05, 0.11))))
    assert moved_look(wide, seen, NAMES, np.array([0.0, -0.04, 0.0])) is None  # marker 3 leaves the image
    # 01-02 alone comes too near to 03-04
    assert moved_look(cell, seen, NAMES[:1], np.array([0.0, -0.01, 0.0])) is None


def test_the_part_of_the_image_that_the_lens_was_calibrated_for_counts(task: Task, seen: Observation) -> None:
    assert moved_look(task.cell, seen, NAMES, UP) is not None
    part = replace(task.cell, camera=replace(task.cell.camera, region=(300.0, 0.0, 1919.0, 1199.0)))
    assert moved_look(part, seen, NAMES, UP) is None


def test_boards_go_up_and_towards_the_arm_in_steps(task: Task, seen: Observation) -> None:
    higher, nearer = (list(looks) for looks in nearer_looks(task.cell, seen, NAMES))
    assert [words for words, _ in higher] == [
        "put boards 01-02 and 03-04 on stands 30 mm higher, nearer to the camera"
    ]
    assert [words for words, _ in nearer] == ["move boards 01-02 and 03-04 by 30 mm towards the arm's base"]
    for look, up, back in ((higher[0][1], 0.03, 0.0), (nearer[0][1], 0.0, 0.03)):
        for was, now in zip(seen.poses, look.poses, strict=True):
            assert np.allclose(now.T_base_board[:3, :3], was.T_base_board[:3, :3])
            by = now.T_base_board[:3, 3] - was.T_base_board[:3, 3]
            assert by[2] == pytest.approx(up)
            assert float(np.hypot(*by[:2])) == pytest.approx(back)
    assert list(nearer_looks(task.cell, Observation(), NAMES)) == []
