"""Recordings of marker corners as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from pictures.boards import lab_board, lab_camera, random_pose, seen_corners
from recorded.sets import recorded_set

CAMERA = lab_camera()

BOARD = lab_board(marker_size=0.040)

POSES = [random_pose(np.random.default_rng(seed), tilt) for seed, tilt in enumerate((0.0, 7.0, 15.0))]


def recorded(noise_px: float = 0.1) -> dict[str, Any]:
    """A file's content, with its truth, in the format of recorded sets."""
    seen = [
        seen_corners(BOARD, T, CAMERA, np.random.default_rng(seed), noise_px=noise_px)
        for seed, T in enumerate(POSES)
    ]
    return recorded_set(BOARD, CAMERA, zip(seen, POSES, strict=True), noise_px)


def written(folder: Path, content: dict[str, Any]) -> Path:
    file = folder / "set.json"
    file.write_text(json.dumps(content))
    return file
