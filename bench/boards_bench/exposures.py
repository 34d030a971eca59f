"""Boards on rendered photographs, exposed in many ways: is the marker size doubted, and only where it is wrong?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from arm.board import Board
from arm.se3 import frozen
from boards_bench.outcomes import Outcome, assessed
from boards_bench.scenes import TILTS_DEG, Conditions, Scene, bound
from pictures.boards import lab_board, lab_camera, random_pose
from pictures.made_boards import glued_aside, made, moved_px
from pictures.markers import Exposure, Pane, panes, photographed
from vision.boards.pose import assess_board

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


TOLERANCE = 1e-4  # m, the cell file's default
FLOOR_PX = (
    0.02  # of every corner, shared by all photographs: what a rendered picture lacks, and estimates assume
)

LIGHTS = (
    "even light",
    "uneven light, one marker saturated",
    "one marker bloomed",
    "glare beside a side",
    "gamma and blur",
    "a gleaming rim inside a side",
)
ASIDE = "one marker glued 0.07 mm aside"
FAULTS = (*LIGHTS, ASIDE)


def _light(fault: str, rng: np.random.Generator) -> Exposure:
    one, other = float(rng.uniform(0.6, 1.0)), float(rng.uniform(1.25, 2.0))
    either = (one, other) if rng.random() < 0.5 else (other, one)
    side, strong = int(rng.integers(4)), float(rng.uniform(60.0, 250.0))
    if fault == LIGHTS[1]:
        return Exposure(gains=either)
    if fault == LIGHTS[2]:
        return Exposure(gains=either, blur_px=float(rng.uniform(1.0, 2.5)))
    if fault == LIGHTS[3]:
        spot = (strong, float(rng.uniform(0.05, 0.3)), float(rng.uniform(0.05, 0.15)), side)
        return Exposure(gain=0.9, glare=spot)
    if fault == LIGHTS[4]:
        return Exposure(gamma=float(rng.uniform(0.45, 0.8)), blur_px=float(rng.uniform(0.7, 2.5)))
    if fault == LIGHTS[5]:
        return Exposure(rim=(strong / 4.0, float(rng.uniform(1.5, 5.0)), side))
    return Exposure(gain=float(rng.uniform(0.6, 1.1)))


def picture_outcomes(seeds: range, fault: str, tolerance: float) -> list[Outcome]:
    """What comes of rendered photographs with a fault of light, of a board made within a tolerance, m."""
    cv2.setNumThreads(1)
    return [found for seed in seeds if (found := _picture(seed, fault, tolerance)) is not None]


def _picture(seed: int, fault: str, tolerance: float) -> Outcome | None:
    rng, camera = np.random.default_rng([seed, 12]), lab_camera()
    board = replace(lab_board(marker_size=SIZES[seed % len(SIZES)]), tolerance=tolerance)
    T = random_pose(rng, TILTS_DEG[(seed // len(SIZES)) % len(TILTS_DEG)])
    frames = photographed(board, panes(board, T), _light(fault, rng), rng)
    if not all(len(frame) == 2 for frame in frames):
        return None
    corners = glued_aside(board, 7e-5, rng) if fault == ASIDE else made(board, rng)
    off = moved_px(board, corners, T, camera) + FLOOR_PX * rng.standard_normal((2, 4, 2))
    frames = [
        [replace(m, corners_px=frozen(m.corners_px + off[board.marker_ids.index(m.id)])) for m in frame]
        for frame in frames
    ]
    scene = Scene(board, T, frames)
    return assessed(scene, bound(scene, Conditions(noise_px=FLOOR_PX), camera), board, frames)
