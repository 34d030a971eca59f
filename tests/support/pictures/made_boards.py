"""How boards are made: markers glued aside, turned, printed too large, within the tolerance that their file states."""

from __future__ import annotations

import numpy as np

from arm.board import TOLERANCE_SDS, Board
from arm.se3 import Array
from vision.boards.shared_errors import OWN_EDGE, SAME_PRINT
from vision.camera.model import Camera


def made(board: Board, rng: np.random.Generator) -> Array:
    """Corners (2, 4, 3) m of a board's markers as drawn from its tolerance."""
    sd = board.tolerance / TOLERANCE_SDS
    outlines = board.marker_corners()
    centres = outlines.mean(axis=1)
    same = SAME_PRINT * sd / board.marker_size * rng.standard_normal()
    drawn = []
    for centre, outline in zip(centres, outlines, strict=True):
        off = outline - centre
        turn = sd / np.linalg.norm(off[0]) * rng.standard_normal()
        scale = 1.0 + same + OWN_EDGE * sd / board.marker_size * rng.standard_normal()
        turned = scale * off + turn * np.stack([-off[:, 1], off[:, 0], 0.0 * off[:, 0]], axis=-1)
        drawn.append(centre + turned + np.append(sd * rng.standard_normal(2), 0.0))
    return np.stack(drawn)


def glued_aside(board: Board, away: float, rng: np.random.Generator) -> Array:
    """Corners (2, 4, 3) m with one marker `away` m aside, to any side."""
    angle, which = rng.uniform(0.0, 2.0 * np.pi), int(rng.integers(2))
    outlines = np.array(board.marker_corners())
    outlines[which] += away * np.array([np.cos(angle), np.sin(angle), 0.0])
    return outlines


def moved_px(board: Board, corners: Array, T_base_board: Array, camera: Camera) -> Array:
    """By how much corners (2, 4, 3) m are seen off those of the board's file, (2, 4, 2) px."""
    R, t = T_base_board[:3, :3], T_base_board[:3, 3]
    return np.asarray(
        camera.project_base(corners @ R.T + t) - camera.project_base(board.marker_corners() @ R.T + t)
    )
