"""Recorded corners of a board's markers: a camera, a board, and scenes of several images each, in one JSON file.

``camera{K_px, distortion_k1k2p1p2k3, size_px}``, ``board{markers[]{id, corners_m[4][3]}, holes_m[4][3]}`` and
``scenes[]{frames[]{markers[]{id, corners_px[4][2]}}}``. Nothing else in the file is read, no ground truth either.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from arm.board import Board
from arm.io.node import Node
from arm.io.rules import integer, numbers
from vision.camera.model import INTRINSIC_MATRIX, Camera, require_px
from vision.markers.detect import Marker

SAME = 1e-6  # m, largest deviation of a marker's corners from a square


@dataclass(frozen=True, eq=False)
class Detections:
    """Contents of a file.

    Attributes:
        camera: at the base frame's origin, as the file has no extrinsics.
        board: the only one.
        scenes: for each, the markers detected in each image.
    """

    camera: Camera
    board: Board
    scenes: tuple[tuple[tuple[Marker, ...], ...], ...]


def read_detections(path: Path) -> Detections:
    """Read a file of recorded corners.

    Raises:
        FileInputError: the format is broken; the message names the key.
    """
    root = Node.of_json(path, "corners")
    return Detections(
        read_recorded_camera(root["camera"]),
        _board(root["board"]),
        tuple(map(_scene, root["scenes"].items())),
    )


def read_recorded_camera(node: Node) -> Camera:
    """A camera at the origin from its intrinsics: ``K_px``, ``distortion_k1k2p1p2k3``, ``size_px``."""
    K, size = node.get("K_px", INTRINSIC_MATRIX), node.get("size_px", numbers(2))
    if not (size == np.rint(size)).all() or size.min() < 1.0:
        raise node["size_px"].error("must be width and height in whole px")
    require_px(node, K, (int(size[0]), int(size[1])))
    return Camera(K, node.get("distortion_k1k2p1p2k3", numbers(5)), (int(size[0]), int(size[1])), np.eye(4))


def _board(node: Node) -> Board:
    markers = node["markers"].items()
    if len(markers) != 2:
        raise node["markers"].error(f"must have two markers, not {len(markers)}")
    low, high = (marker["id"].read(integer(0, 10**6)) for marker in markers)
    if low == high:
        raise markers[1]["id"].error("must differ from that of the first marker")
    corners = np.stack([marker["corners_m"].read(numbers((4, 3))) for marker in markers])
    size = float(np.linalg.norm(corners[0, 1] - corners[0, 0]))
    x, y, _ = corners[1].mean(axis=0) - corners[0].mean(axis=0)
    board = Board(
        f"{low:02d}-{high:02d}",
        (low, high),
        node["holes_m"].read(numbers((4, 3))),
        size,
        (float(x), float(y)),
    )
    if np.abs(board.marker_corners() - corners).max() > SAME:
        raise node["markers"].error(
            "must be two squares of one size, each in the order top left, top right, bottom right, bottom left, the "
            "first one centred at the origin, both parallel to the axes, z = 0"
        )
    return board


def _scene(node: Node) -> tuple[tuple[Marker, ...], ...]:
    frames = node["frames"].items()
    if not frames:
        raise node["frames"].error("must have at least one image")
    return tuple(tuple(map(_marker, frame["markers"].items())) for frame in frames)


def _marker(node: Node) -> Marker:
    return Marker(node["id"].read(integer(0, 10**6)), node["corners_px"].read(numbers((4, 2))), "recorded")
