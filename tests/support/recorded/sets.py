"""Recorded marker corners as a file has them, with the truth that nobody may read."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from arm.board import Board
from arm.se3 import Array
from vision.camera.model import Camera
from vision.markers.detect import Marker


def recorded_set(
    board: Board,
    camera: Camera,
    scenes: Iterable[tuple[Sequence[Sequence[Marker]], Array]],
    noise_px: float,
) -> dict[str, Any]:
    """A file's content.

    Args:
        scenes: of each, the markers of every frame, and T_base_board.
        noise_px: with which they were drawn.
    """
    corners = zip(board.marker_ids, board.marker_corners().tolist(), strict=True)
    return {
        "kind": "two_marker_board",
        "camera": {
            "K_px": camera.K.tolist(),
            "distortion_k1k2p1p2k3": camera.distortion.tolist(),
            "size_px": list(camera.size),
        },
        "board": {
            "markers": [{"id": i, "corners_m": c} for i, c in corners],
            "holes_m": board.holes.tolist(),
        },
        "noise": {"corner_sigma_px": noise_px},
        "scenes": [
            {
                "frames": [
                    {"markers": [{"id": m.id, "corners_px": m.corners_px.tolist()} for m in frame]}
                    for frame in frames
                ],
                "truth": {
                    "R_camera_board": (camera.T_camera_base @ T)[:3, :3].tolist(),
                    "tilt_deg": 3.0,
                },
            }
            for frames, T in scenes
        ],
    }
