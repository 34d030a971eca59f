"""The file of an observation: board poses, holes and cubes, as the JSON of ``a465 look``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from arm.board import Board
from arm.errors import A465Error, FileInputError, ImpossibleError
from arm.former import former_names
from arm.io.storage import read_json, require_finite
from arm.numerics.products import mul
from arm.poses import BoardPose, TiltHypothesis
from arm.se3 import Array, frozen, inverse, orthonormalised
from cell.files.task import Task
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy

HEIGHT_TOLERANCE = 0.010  # between the stated and the detected height of Task 1's board, m
FLAT_TOLERANCE = np.radians(2.0)


def require_boards(seen: Observation, task: Task) -> None:
    """Require that the task's boards were detected, at poses that the task allows.

    Raises:
        ImpossibleError: names the board and the reason.
    """
    for board in task.boards:
        if seen.board(board.name) is None:
            why = seen.missing.get(board.name, "its markers are not in the image")
            raise ImpossibleError(
                f"board {board.name} was not found: {why}; move it completely into the camera's view",
                board=board.name,
                why=why,
            )
    if seen.half_seen:
        name = seen.half_seen[0]
        raise ImpossibleError(
            f"board {name} is partly in view, so its pose is unknown: {seen.missing[name]}; move it completely "
            "into the camera's view, or out of the cell",
            board=name,
            why=seen.missing[name],
        )
    if task.board_height is not None:
        _require_flat(task, seen.board(task.from_board.name))


def _require_flat(task: Task, seen: ObservedBoard | None) -> None:
    if seen is None or task.board_height is None:
        return
    T = seen.pose.T_base_board
    height = float(T[2, 3]) - task.cell.table_z
    if abs(height - task.board_height) > HEIGHT_TOLERANCE or seen.pose.tilt() > FLAT_TOLERANCE:
        raise ImpossibleError(
            f"board {seen.name} was detected {1e3 * height:.0f} mm above the table, tilted by "
            f"{np.degrees(seen.pose.tilt()):.1f} deg, but the task says {1e3 * task.board_height:.0f} mm and flat; "
            f"correct board_height_mm in {task.file} or the stand",
            board=seen.name,
            height=height,
            tilt=seen.pose.tilt(),
        )


def observation_to_json(seen: Observation, T_base_camera: Array) -> dict[str, Any]:
    """Return the JSON of ``a465 look``: one scene, with the reasons for missing boards."""
    boards = [_board_to_json(b, T_base_camera) for b in seen.boards]
    return {"scenes": [{"boards": boards, "missing": dict(seen.missing), "half_seen": list(seen.half_seen)}]}


def pose_to_json(pose: BoardPose, T_base_camera: Array) -> dict[str, Any]:
    """Return a board's pose, its uncertainty and its holes as JSON types."""
    return {
        "marker_ids": list(pose.board.marker_ids),
        "T_camera_board": (mul(inverse(T_base_camera), pose.T_base_board)).tolist(),
        "T_base_board": pose.T_base_board.tolist(),
        "covariance": pose.covariance.tolist(),
        "residual_px": pose.residual_px,
        "hypothesis_ratio": pose.hypothesis_ratio,
        "tilt_deg": float(np.degrees(pose.tilt())),
        "tilt_hypothesis": _tilt_to_json(pose.tilt_hypothesis),
        "holes": [
            {
                "hole": hole.name,
                "T_base_hole": hole.T_base_hole.tolist(),
                "std_mm": (1e3 * np.sqrt(np.diag(hole.covariance)[:3])).tolist(),
            }
            for hole in pose.holes
        ],
    }


def _tilt_to_json(tilt: TiltHypothesis | None) -> dict[str, Any] | None:
    """Return None if no tilts are known. `fits` is false for a board at none of them."""
    if tilt is None:
        return None
    return {
        "nearest_deg": float(np.degrees(tilt.nearest)),
        "z": tilt.z,
        "probability": tilt.probability,
        "fits": tilt.fits,
    }


def member_words(pose: BoardPose) -> str:
    """Return which of the known tilts a board has, such as ``7 (z 0.4)``."""
    tilt = pose.tilt_hypothesis
    if tilt is None:
        return "-"
    nearest = f"{np.degrees(tilt.nearest):g}"
    return f"{nearest} (z {tilt.z:.1f})" if tilt.fits else f"none (z {tilt.z:.1f} from {nearest})"


def tilt_words(pose: BoardPose) -> str:
    """Return a board's tilt from the vertical, and which of the known tilts it is."""
    tilt = f"{np.degrees(pose.tilt()):.2f} deg"
    return tilt if pose.tilt_hypothesis is None else f"{tilt}, stand {member_words(pose)}"


def _board_to_json(seen: ObservedBoard, T_base_camera: Array) -> dict[str, Any]:
    value = pose_to_json(seen.pose, T_base_camera)
    for hole, occupancy in zip(value["holes"], seen.occupancy, strict=True):
        hole["state"] = occupancy.state
        if occupancy.state == "unsure":
            hole["reason"] = occupancy.reason
    return {"board": seen.name, "verdict": "accepted", "reasons": [], **value}


def read_observation(path: Path, boards: Sequence[Board]) -> Observation:
    """Read a look file; `boards`: those of the cell.

    Raises:
        FileInputError: the file is not a look file, or has boards that the cell does not list.
    """
    value = read_json(path)
    require_finite(path, value)
    try:
        scene = value["scenes"][0]
        found = [_board_from_json(path, entry, boards) for entry in scene["boards"]]
        half_seen = tuple(str(name) for name in scene.get("half_seen", []))
        missing = {str(name): str(why) for name, why in scene.get("missing", {}).items()}
        return Observation(tuple(found), missing, tuple(name for name in half_seen if name in missing))
    except KeyError as error:
        raise FileInputError(
            path, str(error.args[0]), None, "is missing; a465 look writes it", "look again"
        ) from error
    except (IndexError, TypeError, ValueError) as error:
        raise FileInputError(
            path,
            "scenes",
            None,
            "is not as written by a465 look",
            "look again",
        ) from error


def _tilt_from_json(entry: dict[str, Any] | None) -> TiltHypothesis | None:
    if entry is None:
        return None
    nearest, z, probability = (float(entry[key]) for key in ("nearest_deg", "z", "probability"))
    return TiltHypothesis(float(np.radians(nearest)), z, probability, bool(entry["fits"]))


def _board_from_json(path: Path, entry: dict[str, Any], boards: Sequence[Board]) -> ObservedBoard:
    board = next((b for b in boards if list(b.marker_ids) == entry["marker_ids"]), None)
    if board is None:
        raise FileInputError(path, "marker_ids", entry["marker_ids"], "is not a board of the cell file")
    try:
        T_base_board = orthonormalised(entry["T_base_board"])
    except A465Error as error:
        raise FileInputError(path, f"{board.name}.T_base_board", None, str(error)) from error
    covariance: Array = frozen(entry["covariance"])
    if covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        raise FileInputError(
            path, f"{board.name}.covariance", list(covariance.shape), "must be 6 by 6, finite"
        )
    if entry["verdict"] != "accepted":
        raise FileInputError(
            path, f"{board.name}.verdict", entry["verdict"], "must be 'accepted'", "look again"
        )
    if [hole["hole"] for hole in entry["holes"]] != [
        f"{board.name}/{n}" for n in range(1, len(entry["holes"]) + 1)
    ]:
        raise FileInputError(path, f"{board.name}.holes", None, "must be in the order of the board's file")
    states = tuple(hole["state"] for hole in entry["holes"])
    if len(states) != 4 or not set(states) <= {"cube", "empty", "unsure"}:
        raise FileInputError(path, f"{board.name}.holes", states, "must be four of cube, empty, unsure")
    occupancy = tuple(Occupancy(hole["state"], reason=str(hole.get("reason", ""))) for hole in entry["holes"])
    pose = BoardPose(
        board,
        T_base_board,
        covariance,
        float(entry["residual_px"]),
        float(entry["hypothesis_ratio"]),
        _tilt_from_json(entry.get("tilt_hypothesis")),
    )
    return ObservedBoard(pose, occupancy)


former_names(
    __name__,
    __name__,
    Seen="Observation",
    SeenBoard="ObservedBoard",
    read_seen="read_observation",
    seen_to_json="observation_to_json",
)
