"""Targets in pictures."""

import numpy as np

from arm.se3 import Array
from cell.sim.target_photos import Shot, photograph_target, target_pose
from pictures.boards import lab_camera
from vision.camera.model import Image
from vision.targets.target import Target

CAMERA = lab_camera()

MIDDLE = np.array([960.0, 600.0])

BOARD = Target()


def photograph(
    target: Target, seed: int, shot: Shot | None = None, roll: float | None = None
) -> tuple[Image, Array]:
    """A photograph of a target in the middle of the image, tilted, and its pose."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(-0.4, 0.4, 2)
    T = target_pose(CAMERA, target, MIDDLE, 1.05, turn, rng.uniform(-np.pi, np.pi) if roll is None else roll)
    return photograph_target(CAMERA, target, T, rng, shot), T
