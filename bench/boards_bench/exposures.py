"""Boards on rendered photographs, exposed in many ways: is the marker size doubted, and only where it is wrong?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from arm.board import Board
from board_scenes import lab_board, lab_camera, random_pose
from boards_bench.scenes import TILTS_DEG
from marker_pictures import Exposure, Pane, panes, photographed
from vision.board_pose import assess_board

EXPOSURES = 10
SIZES = (0.036, 0.040)  # m
PRINT = 0.005  # largest part by which a print is too large or small
WRONG = 1e-3  # m by which the stated size is wrong


@dataclass(frozen=True)
class SizeOutcome:
    """Of one set of photographs: is the right size refused, is it refused for another reason, is a wrong one named."""

    refused_as_size: bool
    refused_else: bool
    wrong_named: bool


def size_outcomes(seed: int) -> list[SizeOutcome | None]:
    """Of one scene under `EXPOSURES` exposures; None where a marker is not found."""
    cv2.setNumThreads(1)
    rng = np.random.default_rng([seed, 11])
    board = lab_board(marker_size=SIZES[seed % len(SIZES)])
    T = random_pose(rng, TILTS_DEG[(seed // len(SIZES)) % len(TILTS_DEG)])
    around = panes(replace(board, marker_size=board.marker_size * (1.0 + rng.uniform(-PRINT, PRINT))), T)
    return [_outcome(board, around, rng) for _ in range(EXPOSURES)]


def _outcome(board: Board, around: list[Pane], rng: np.random.Generator) -> SizeOutcome | None:
    gain = float(np.exp(rng.uniform(np.log(0.5), np.log(1.6))))
    of = Exposure(gain=gain, gamma=float(rng.uniform(0.45, 1.0)), blur_px=float(rng.uniform(0.3, 3.0)))
    frames = photographed(board, around, of, rng)
    if not all(len(frame) == 2 for frame in frames):
        return None
    stated = replace(board, marker_size=board.marker_size + float(rng.choice((-WRONG, WRONG))))
    doubts = [str(doubt) for doubt in assess_board(board, frames, lab_camera()).doubts]
    as_size = any("marker size" in doubt for doubt in doubts)
    named = any(
        "marker size" in str(doubt) for doubt in assess_board(stated, frames, lab_camera()).doubts[:1]
    )
    return SizeOutcome(as_size, bool(doubts) and not as_size, named)
