"""Hole poses of a board pose, and their covariances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from arm import se3
from arm.board import TOLERANCE_SDS, read_board_csv
from arm.io.storage import data_file
from arm.poses import BoardPose, adjoint
from arm.se3 import Array


def _pose(seed: int, tolerance: float = 0.0) -> BoardPose:
    rng = np.random.default_rng(seed)
    board = read_board_csv(data_file("scenes/boards/positions_plate_01-02.csv"), 0.036)
    A = rng.normal(size=(6, 6)) * 1e-3
    T_base_board = se3.transform(se3.rotation(rng.normal(size=3)), rng.normal(size=3))
    return BoardPose(replace(board, tolerance=tolerance), T_base_board, A @ A.T, 0.1, 3.0)


def _exp(twist: Array) -> Array:
    """Return the transform of a small twist (translation first), to first order."""
    return se3.transform(Rotation.from_rotvec(twist[3:]).as_matrix(), twist[:3])


def _small_twist(T: Array) -> Array:
    return np.concatenate([T[:3, 3], Rotation.from_matrix(T[:3, :3]).as_rotvec()])


def test_holes_are_computed_once() -> None:
    pose = _pose(1)
    assert pose.holes is pose.holes


@pytest.mark.parametrize("seed", range(4))
def test_hole_poses_follow_the_board_pose(seed: int) -> None:
    pose = _pose(seed)
    assert [(h.name, h.index) for h in pose.holes] == [(f"01-02/{i + 1}", i) for i in range(4)]
    for hole in pose.holes:
        expected = pose.T_base_board @ pose.board.T_board_hole(hole.index)
        assert np.abs(hole.T_base_hole - expected).max() < 1e-14


@pytest.mark.parametrize("seed", range(4))
def test_a_covariance_is_propagated_by_the_finite_differences_of_the_hole(seed: int) -> None:
    pose, step = _pose(seed), 1e-6
    for hole in pose.holes:
        T_board_hole = pose.board.T_board_hole(hole.index)
        J = np.empty((6, 6))
        for k, e in enumerate(np.eye(6)):
            ahead, behind = (
                _small_twist(se3.inverse(T_board_hole) @ _exp(s * e) @ T_board_hole) for s in (step, -step)
            )
            J[:, k] = (ahead - behind) / (2 * step)
        assert np.abs(J - adjoint(se3.inverse(T_board_hole))).max() < 1e-8
        expected = J @ pose.covariance @ J.T
        assert np.abs(hole.covariance - expected).max() < 1e-8 * np.abs(expected).max()


def test_the_tolerance_of_the_plate_adds_to_x_and_y_alone() -> None:
    exact, made = _pose(5), _pose(5, tolerance=0.0004)
    for a, b in zip(exact.holes, made.holes, strict=True):
        added = np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]) * (0.0004 / TOLERANCE_SDS) ** 2
        assert np.abs(b.covariance - a.covariance - added).max() < 1e-18
