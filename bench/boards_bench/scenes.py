"""Boards before the lab's camera, their corners with stated noise, and the Cramer-Rao bound of each scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from arm.board import Board
from arm.poses import adjoint
from arm.se3 import Array, inverse
from pictures.boards import lab_board, lab_camera, random_pose, seen_corners, spoiled
from vision.camera.model import Camera
from vision.camera.projection import Projection
from vision.markers.detect import Marker

TILTS_DEG = (0.0, 7.0, 15.0)
FRAMES, NOISE_PX = 5, 0.3

Frames = list[list[Marker]]


@dataclass(frozen=True)
class Conditions:
    """How the corners of a row are drawn.

    Attributes:
        noise_px, common_px: of each photograph, and shared by all of a scene.
        bad: part of the photographs with one corner 8 px off.
        sizes: of the markers, m, in turn.
        tilts_deg: in turn, each +- 0.3.
        frames: photographs.
    """

    noise_px: float = NOISE_PX
    common_px: float = 0.0
    bad: float = 0.0
    sizes: tuple[float, ...] = (0.036, 0.040)
    tilts_deg: tuple[float, ...] = TILTS_DEG
    frames: int = FRAMES


@dataclass(frozen=True)
class Scene:
    """One board, where it truly is, and what was seen of it."""

    board: Board
    T_base_board: Array
    frames: Frames


def drawn(seed: int, of: Conditions) -> Scene:
    """The scene of a seed."""
    rng = np.random.default_rng([seed, 5])
    board = lab_board(marker_size=of.sizes[seed % len(of.sizes)])
    tilt = of.tilts_deg[(seed // len(of.sizes)) % len(of.tilts_deg)] + rng.uniform(-0.3, 0.3)
    T = random_pose(rng, abs(tilt))
    frames = seen_corners(board, T, lab_camera(), rng, of.frames, of.noise_px, of.common_px)
    return Scene(board, T, [spoiled(f, rng) if rng.random() < of.bad else f for f in frames])


def bound(scene: Scene, of: Conditions, camera: Camera) -> Array:
    """Cramer-Rao bound of the twist, (6, 6): every corner of every photograph, the shared noise once."""
    points = scene.board.marker_corners().reshape(8, 3)
    J = Projection(camera, camera.T_camera_base @ scene.T_base_board, points).by_target.reshape(-1, 6)
    return np.asarray((of.noise_px**2 / of.frames + of.common_px**2) * np.linalg.inv(J.T @ J))


def hole_levers(board: Board) -> list[Array]:
    """For each hole the (3, 6) map from the board's twist to the hole's movement, in the board's frame."""
    return [adjoint(inverse(board.T_board_hole(i)))[:3] for i in range(4)]
