"""Looks at boards that stand nearer to the camera or to the arm, as a measure against errors of both.

Corners are as many pixels off as before, so a board is seen more exactly where its corners move further in the image.
Errors of joints count less near the base. Errors of print and mounting stay with the board.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from arm.numerics.products import mul
from arm.poses import BoardPose
from arm.se3 import Array, apply, frozen, inverse, transform
from cell.config.cell import Cell
from cell.scene.board_doubts import outside_zone
from vision.camera.projection import Projection
from vision.observation import Observation

_BY = (0.03, 0.06, 0.1)  # m


def nearer_looks(
    cell: Cell, seen: Observation, names: Collection[str]
) -> Iterator[Iterator[tuple[str, Observation]]]:
    """Yield what to do, and the look to expect after it: boards on higher stands, then boards nearer to the arm.

    Boards move together, so that they do not come nearer to each other.

    Args:
        cell: the cell.
        seen: present look.
        names: of the boards to move.
    """
    centres = np.array([_centre(pose) for pose in seen.poses if pose.board.name in names])
    if not len(centres):
        return
    x, y = centres.mean(axis=0)[:2]
    towards = -np.array([x, y, 0.0]) / max(float(np.hypot(x, y)), 1e-9)
    shown = " and ".join(sorted(names))
    ways = (
        (np.array([0.0, 0.0, 1.0]), "put boards {} on stands {:g} mm higher, nearer to the camera"),
        (towards, "move boards {} by {:g} mm towards the arm's base"),
    )

    def looks(direction: Array, words: str) -> Iterator[tuple[str, Observation]]:
        for by in _BY:
            look = moved_look(cell, seen, names, by * direction)
            if look is not None:
                yield words.format(shown, 1e3 * by), look

    for direction, words in ways:
        yield looks(direction, words)


def moved_look(cell: Cell, seen: Observation, names: Collection[str], by: Array) -> Observation | None:
    """The look to expect with boards moved by `by` (3,) m; None if one may not stand there or is not seen whole."""
    shift = transform(t=by)
    boards = []
    for board in seen.boards:
        pose = board.pose
        if pose.board.name in names:
            pose = _moved(cell, pose, frozen(mul(shift, pose.T_base_board)))
            if not _may_stand(cell, pose):
                return None
        boards.append(replace(board, pose=pose))
    for one, other in combinations(boards, 2):
        moved = [of.pose.board.name in names for of in (one, other)]
        if any(moved) and not all(moved) and _may_touch(one.pose, other.pose):
            return None
    return replace(seen, boards=tuple(boards), images=(), frames=())


def _moved(cell: Cell, pose: BoardPose, T_base_board: Array) -> BoardPose:
    """A board's pose elsewhere.

    Let J be the derivative of the corners' pixels by the board's twist, and J'J = R'R with triangular R. If all pixels
    have independent errors s, the twist's covariance is s^2 inv(J'J), and that of R times the twist s^2 1, anywhere.
    """
    if pose.repeatability is None:
        return replace(pose, T_base_board=T_base_board)
    here, there = (_information_root(cell, pose, T) for T in (pose.T_base_board, T_base_board))
    scale = np.linalg.solve(there, here)
    noise = frozen(scale @ pose.repeatability @ scale.T)
    covariance = frozen(pose.covariance - pose.repeatability + noise)
    return replace(pose, T_base_board=T_base_board, covariance=covariance, repeatability=noise)


def _information_root(cell: Cell, pose: BoardPose, T_base_board: Array) -> Array:
    """Upper triangular R (6, 6) with R'R the information that unit errors of the pixels leave."""
    T_camera_board = mul(inverse(cell.camera.T_base_camera), T_base_board)
    corners = pose.board.marker_corners().reshape(-1, 3)
    seen = Projection(cell.camera.at(np.eye(4)), T_camera_board, corners)
    root = np.linalg.qr(seen.by_target.reshape(-1, 6), mode="r")
    return np.asarray(root * np.sign(np.diag(root))[:, None])


def _may_stand(cell: Cell, pose: BoardPose) -> bool:
    """Whether the plate is in the zone for boards, and its markers and pockets in the image."""
    if outside_zone(cell, pose) > 0.0:
        return False
    square = np.array([[i, j, 0.0] for i in (-1, 1) for j in (-1, 1)]) / 2.0
    pockets = pose.board.holes[:, None] + square * pose.board.pocket[0]
    shown = np.concatenate([pose.board.marker_corners().reshape(-1, 3), pockets.reshape(-1, 3)])
    pixels = cell.camera.project_base(apply(pose.T_base_board, shown))
    left, upper, right, lower = cell.camera.region or (0.0, 0.0, *(np.array(cell.camera.size) - 1.0))
    return bool(((pixels >= (left, upper)) & (pixels <= (right, lower))).all())  # NaN behind the camera


def _centre(pose: BoardPose) -> Array:
    return np.asarray(apply(pose.T_base_board, (*pose.board.plate.centre, 0.0)))


def _may_touch(one: BoardPose, other: BoardPose) -> bool:
    """Whether the plates of two boards are so close that they might touch."""
    reach = sum(float(np.hypot(*pose.board.plate.size[:2])) for pose in (one, other)) / 2.0
    return bool(np.linalg.norm(_centre(one) - _centre(other)) < reach)
