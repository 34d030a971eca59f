"""``a465 look --detections``: board poses from recorded marker corners, with a verdict for every scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.io.outputs import keep_apart
from arm.io.storage import canonical_json, keep_unread, write_atomic
from arm.poses import BoardPose
from arm.se3 import Array
from cell.config.board_keys import MADE_WITHIN_MM
from cell.console import Console
from cell.files.observation import member_words, pose_to_json
from cell.files.task import read_task
from vision.boards.pose import BoardAssessment, BoardLimits, assess_board
from vision.markers.recorded import read_detections


def detections_step(
    file: Path, task_file: Path | None, output: Path | None, console: Console
) -> dict[str, Any]:
    """Estimate the board poses of all scenes of a file, in the base frame of the task's cell or the camera frame.

    Raises:
        InputError: a file is wrong, or cannot be written.
    """
    keep_apart(output, file, task_file, kind="look")
    keep_unread(output)
    recorded = read_detections(file)
    camera, limits, board = recorded.camera, BoardLimits(), recorded.board
    tilts: tuple[float, ...] = ()
    tolerance = MADE_WITHIN_MM / 1e3
    if task_file is not None:
        cell = read_task(task_file).cell
        camera, limits, tilts = camera.at(cell.camera.T_base_camera), cell.board_limits, cell.tilts
        tolerance = cell.boards[0].tolerance
    board = replace(board, tolerance=tolerance)
    seen = [assess_board(board, frames, camera, limits, tilts) for frames in recorded.scenes]
    result = {"scenes": [{"boards": [_to_json(recorded.board.name, s, camera.T_base_camera)]} for s in seen]}
    if output is not None:
        write_atomic(output, canonical_json(result) + "\n")
    _print_table(seen, camera.T_camera_base, bool(tilts), console)
    return result


def _to_json(name: str, seen: BoardAssessment, T_base_camera: Array) -> dict[str, Any]:
    pose = seen.pose
    common = {
        "board": name,
        "verdict": "accepted" if seen.accepted else "refused",
        "reasons": [str(doubt) for doubt in seen.doubts],
    }
    if pose is None:
        empty = ("T_camera_board", "T_base_board", "covariance", "repeatability", "residual_px")
        more = ("hypothesis_ratio", "tilt_deg", "tilt_hypothesis")
        return {**common, **dict.fromkeys((*empty, *more)), "holes": []}
    return {**common, **pose_to_json(pose, T_base_camera), "tilt_deg": _tilt_deg(pose)}


def _tilt_deg(pose: BoardPose) -> float:
    """Angle of the board's normal to the base z-axis; to the optical axis if the camera frame is the base frame."""
    return float(np.degrees(np.arccos(np.clip(abs(pose.T_base_board[2, 2]), 0.0, 1.0))))


def _print_table(seen: list[BoardAssessment], T_camera_base: Array, tilts: bool, console: Console) -> None:
    header = (
        *("scene", "x mm", "y mm", "z mm", "tilt deg"),
        *(["tilt class"] if tilts else []),
        *("std mm", "px", "verdict"),
    )
    rows = [
        (
            number,
            *(1e3 * (T_camera_base @ s.pose.T_base_board)[:3, 3]),
            _tilt_deg(s.pose),
            *([member_words(s.pose)] if tilts else []),
            1e3 * float(np.sqrt(np.trace(s.pose.holes[0].covariance[:3, :3]))),
            s.pose.residual_px,
            "accepted" if s.accepted else "refused",
        )
        if s.pose is not None
        else (number, *[None] * (len(header) - 2), "refused")
        for number, s in enumerate(seen, start=1)
    ]
    console.table(header, rows)
    for number, s in enumerate(seen, start=1):
        for doubt in s.doubts:
            console.say(f"scene {number}: {doubt}")
    refused = sum(not s.accepted for s in seen)
    console.say(f"{len(seen)} scenes, {len(seen) - refused} accepted, {refused} refused (camera frame)")
