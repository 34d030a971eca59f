"""Boards before the lab's camera: true poses, rendered photographs, and corners with stated noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from arm.board import PLATE_CENTRE, Board, read_board_csv
from arm.io.storage import data_file
from arm.robot.shapes import Body, Box
from arm.se3 import Array, frozen, inverse, rot_z, rotation, rotation_vector, transform
from cell.scene.bodies import T_hole_cube, cube_body, plate_body
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Camera, Image, read_camera
from vision.markers.detect import Marker

MARKER = 0.036
CUBE = 0.040
TABLE = Body("table", Box((1.3, 1.5, 0.04)), transform(t=(0.35, 0.0, -0.02)), "table")


def lab_camera() -> Camera:
    """The camera of the first report."""
    return read_camera(data_file("scenes/cameras/lab.toml"))


def lab_board(name: str = "01-02", marker_size: float = MARKER) -> Board:
    """One of the lab's boards."""
    return read_board_csv(data_file(f"scenes/boards/positions_plate_{name}.csv"), marker_size)


def window(camera: Camera, low: Sequence[float], size: tuple[int, int]) -> Camera:
    """The camera with a part of its image only: pixel `low` becomes (0, 0). Cheap to render."""
    K = camera.K.copy()
    K[:2, 2] -= low
    return replace(camera, K=frozen(K), size=size)


def smaller(camera: Camera, factor: float) -> Camera:
    """The same view with fewer pixels."""
    K = camera.K.copy()
    K[:2] *= factor
    return replace(camera, K=frozen(K), size=(round(camera.size[0] * factor), round(camera.size[1] * factor)))


def leaning(centre: Sequence[float], yaw_deg: float, tilt_deg: float, azimuth_deg: float) -> Array:
    """T_base_board of a board whose plate centre is at `centre` (3,) m and whose top leans towards `azimuth_deg`."""
    yaw, tilt, azimuth = np.radians([yaw_deg, tilt_deg, azimuth_deg])
    R = rotation(tilt * np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])) @ rot_z(yaw)
    return transform(R, np.array(centre) - R @ (*PLATE_CENTRE, 0.0))


def random_pose(rng: np.random.Generator, tilt_deg: float) -> Array:
    """T_base_board in the middle of the view (both markers in it), any yaw, leaning anywhere."""
    centre = (rng.uniform(0.435, 0.445), rng.uniform(-0.03, 0.0), rng.uniform(0.03, 0.08))
    return leaning(centre, rng.uniform(-180, 180), tilt_deg, rng.uniform(-180, 180))


@dataclass(frozen=True)
class Photographed:
    """Photographs with what is true in them."""

    images: list[Image]
    placed: list[PlacedBoard]
    cubes: dict[str, list[bool]]


def photograph(
    camera: Camera,
    boards: Sequence[tuple[Board, Array]],
    rng: np.random.Generator,
    count: int = 1,
    cubes: dict[str, list[bool]] | None = None,
    bodies: Sequence[Body] = (),
    light: float = 1.0,
    noise: float = 2.0,
    dictionary: str = "DICT_4X4_50",
) -> Photographed:
    """Render boards with cubes once and draw `count` noises on it; `light` scales the brightness."""
    placed = [PlacedBoard(board, T) for board, T in boards]
    cubes = cubes or {board.name: [False] * 4 for board, _ in boards}
    scene = [TABLE, *bodies, *(plate_body(board.name, T) for board, T in boards)]
    for board, T in boards:
        scene += [
            cube_body(f"cube {board.name}/{i}", CUBE, T @ board.T_board_hole(i) @ T_hole_cube(CUBE))
            for i in range(4)
            if cubes[board.name][i]
        ]
    clean = (light * render(camera, scene, placed, dictionary)).astype(np.float32)
    return Photographed([with_noise(clean, rng, noise) for _ in range(count)], placed, cubes)


def seen_corners(
    board: Board,
    T_base_board: Array,
    camera: Camera,
    rng: np.random.Generator,
    frames: int = 5,
    noise_px: float = 0.3,
    common_px: float = 0.0,
) -> list[list[Marker]]:
    """Detections of a board's markers without an image: noise of each frame, and noise that all frames share."""
    true_px = camera.project_base(board.marker_corners() @ T_base_board[:3, :3].T + T_base_board[:3, 3])
    shared = true_px + common_px * rng.standard_normal(true_px.shape)
    return [
        [
            Marker(i, frozen(corners), "lines")
            for i, corners in zip(
                board.marker_ids, shared + noise_px * rng.standard_normal(shared.shape), strict=True
            )
        ]
        for _ in range(frames)
    ]


def twist_between(T_estimate: Array, T_true: Array) -> Array:
    """The twist (translation, rotation) (6,) with T_true = T_estimate exp(xi), to first order."""
    E = inverse(T_estimate) @ T_true
    return np.concatenate([E[:3, 3], rotation_vector(E[:3, :3])])


def spoiled(frame: list[Marker], rng: np.random.Generator, off_px: float = 8.0) -> list[Marker]:
    """The same detections with one corner off to some side."""
    marker, corner, angle = int(rng.integers(2)), int(rng.integers(4)), rng.uniform(0.0, 2.0 * np.pi)
    corners = frame[marker].corners_px.copy()
    corners[corner] += off_px * np.array([np.cos(angle), np.sin(angle)])
    return [replace(m, corners_px=frozen(corners)) if i == marker else m for i, m in enumerate(frame)]
