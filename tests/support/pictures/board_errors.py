"""Errors of board poses over seeded scenes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.poses import adjoint
from arm.se3 import Array, inverse
from pictures.boards import lab_board, lab_camera, random_pose, seen_corners, spoiled, twist_between
from vision.boards.pose import assess_board
from vision.camera.projection import Projection

CAMERA = lab_camera()
BOARD = lab_board()

TILTS = (0.0, 7.0, 15.0)


def bound(board: Board, T_base_board: Array, variance_px: float) -> Array:
    """Cramer-Rao bound of the twist for a variance of the mean corners, (6, 6)."""
    points = board.marker_corners().reshape(8, 3)
    J = Projection(CAMERA, inverse(CAMERA.T_base_camera) @ T_base_board, points).by_target.reshape(-1, 6)
    return np.asarray(variance_px * np.linalg.inv(J.T @ J))


@dataclass(frozen=True)
class Parts:
    """Mean squares of a twist or traces of a covariance: holes and depth (m^2), turn (rad^2)."""

    hole: float
    depth: float
    turn: float

    @classmethod
    def of(cls, C: Array, board: Board, T_base_board: Array) -> Parts:
        """Of a covariance of the board's twist; a single error as xi xi^T."""
        levers = [adjoint(inverse(board.T_board_hole(i)))[:3] for i in range(4)]
        ray = (CAMERA.T_camera_base @ T_base_board)[2, :3]
        return cls(
            float(np.mean([np.trace(L @ C @ L.T) for L in levers])),
            float(np.mean([ray @ L @ C @ L.T @ ray for L in levers])),
            float(np.trace(C[3:, 3:])),
        )


@dataclass(frozen=True)
class Ratios:
    """Roots of pooled sums: error and prediction over the bound; `nees` per degree of freedom; worst turn, rad."""

    over_bound: Parts
    predicted: Parts
    nees: Array
    worst_turn: float


def trials(
    count: int, frames: int = 5, common_px: float = 0.0, bad: float = 0.0, size: float = 0.036
) -> Ratios:
    """Pooled over seeded scenes; `bad` is the part of frames with one corner 8 px off."""
    board, found = lab_board(marker_size=size), []
    nees, worst = [], 0.0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        T = random_pose(rng, TILTS[seed % 3])
        seen = seen_corners(board, T, CAMERA, rng, frames, common_px=common_px)
        pose = assess_board(board, [spoiled(f, rng) if rng.random() < bad else f for f in seen], CAMERA).pose
        assert pose is not None
        xi = twist_between(pose.T_base_board, T)
        C = bound(board, T, 0.3**2 / frames + common_px**2)
        parts = [Parts.of(matrix, board, T) for matrix in (np.outer(xi, xi), C, pose.covariance)]
        found.append([[p.hole, p.depth, p.turn] for p in parts])
        nees.append(xi @ np.linalg.solve(pose.covariance, xi) / 6.0)
        worst = max(worst, float(np.linalg.norm(xi[3:])))
    error, least, predicted = np.sqrt(np.sum(found, axis=0))
    return Ratios(Parts(*(error / least)), Parts(*(predicted / least)), np.array(nees), worst)
