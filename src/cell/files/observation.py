"""The file of an observation: board poses, holes and cubes, as the JSON of ``a465 look``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from arm.board import Board
from arm.errors import A465Error, FileInputError, ImpossibleError
from arm.former import former_names
from arm.io.node import Node, Rule
from arm.io.rules import covariance_matrix, exceeds, flag, is_number, numbers, rigid, rule_of, text
from arm.io.storage import require_finite
from arm.numerics.products import mul
from arm.poses import BoardPose, TiltHypothesis
from arm.se3 import Array, angle_between, inverse, orthonormalised
from cell.config.cell import Cell
from cell.files.task import Task
from vision.camera.model import Camera
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import HoleState, Occupancy

HEIGHT_TOLERANCE = 0.010  # between the stated and the detected height of Task 1's board, m
FLAT_TOLERANCE = np.radians(2.0)
_FARTHEST = 10.0  # m of a board from the base
SAME_MM = 1e-4  # of sizes and places of markers in two files
CAMERA_OFF, CAMERA_TURNED = 0.05e-3, float(np.radians(0.005))  # of the camera since a look, m and rad


def require_boards(seen: Observation, task: Task, look: Path | None = None) -> None:
    """Require that the task's boards were detected, at poses that the task allows.

    Args:
        seen: what was detected.
        task: the task.
        look: the file that it was read from, which the message then names; None: the camera has just seen it.

    Raises:
        ImpossibleError: names the board and the reason.
    """
    of = "" if look is None else f"{look}: "
    for board in task.boards:
        if seen.board(board.name) is None:
            why = seen.missing.get(board.name, "its markers are not in the image")
            help = "move it completely into the camera's view"
            if "boards.dictionary" in why:  # markers of another print are in view
                help = (
                    "make file and print agree"
                    if "boards.dictionary is" in why
                    else "give images of the boards"
                )
            if look is not None:
                names = ", ".join(one.name for one in seen.boards)
                help += f" and look again; this look has {f'board {names}' if names else 'no board'}"
            message = f"{of}board {board.name} was not found: {why}; {help}"
            raise ImpossibleError(message, board=board.name, why=why)
    if seen.half_seen:
        name = seen.half_seen[0]
        raise ImpossibleError(
            f"{of}board {name} is partly in view, so its pose is unknown: {seen.missing[name]}; move it completely "
            "into the camera's view, or out of the cell",
            board=name,
            why=seen.missing[name],
        )
    source = seen.board(task.from_board.name)
    if source is not None and task.board_height is not None:
        _require_flat(task, task.board_height, source, of)


def _require_flat(task: Task, stated: float, seen: ObservedBoard, of: str) -> None:
    """Require that a board is at the height that the task states, m, and not tilted; `of`: the look's file, or ""."""
    height = float(seen.pose.T_base_board[2, 3]) - task.cell.table_z
    if abs(height - stated) > HEIGHT_TOLERANCE or seen.pose.tilt() > FLAT_TOLERANCE:
        raise ImpossibleError(
            f"{of}board {seen.name} was detected {1e3 * height:.0f} mm above the table, tilted by "
            f"{np.degrees(seen.pose.tilt()):.1f} deg, but the task says {1e3 * stated:.0f} mm and flat; "
            f"correct board_height_mm in {task.file} or the stand{', or look again' if of else ''}",
            board=seen.name,
            height=height,
            tilt=seen.pose.tilt(),
        )


def observation_to_json(seen: Observation, camera: Camera) -> dict[str, Any]:
    """Return the JSON of ``a465 look`` by a camera: one scene, with the reasons for missing boards."""
    boards = [_board_to_json(b, camera.T_base_camera) for b in seen.boards]
    shift = {} if seen.camera_shift is None else {"camera": seen.camera_shift.to_json()}
    left = {"missing": dict(seen.missing), "half_seen": list(seen.half_seen)}
    return {"scenes": [{"boards": boards, "lens": camera.lens_digest, **left, **shift}]}


def pose_to_json(pose: BoardPose, T_base_camera: Array) -> dict[str, Any]:
    """Return a board's pose, its uncertainty and its holes as JSON types."""
    return {
        "marker_ids": list(pose.board.marker_ids),
        "marker_size_mm": round(1e3 * pose.board.marker_size, 6),
        "second_marker_mm": [round(1e3 * v, 6) for v in pose.board.second_marker],
        "T_camera_board": (mul(inverse(T_base_camera), pose.T_base_board)).tolist(),
        "T_base_board": pose.T_base_board.tolist(),
        "covariance": pose.covariance.tolist(),
        "repeatability": None if pose.repeatability is None else pose.repeatability.tolist(),
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
    """Return the nearest known tilt; None if none are known. `fits` is false if the board has none of them."""
    if tilt is None:
        return None
    return {
        "nearest_deg": float(np.degrees(tilt.nearest)),
        "z": tilt.z,
        "probability": tilt.probability,
        "fits": tilt.fits,
    }


def member_words(pose: BoardPose) -> str:
    """Return the known tilt that a board has, in deg with its z-score, such as ``7 (z 0.4)``."""
    tilt = pose.tilt_hypothesis
    if tilt is None:
        return "-"
    nearest = f"{np.degrees(tilt.nearest):g}"
    return f"{nearest} (z {tilt.z:.1f})" if tilt.fits else f"none (z {tilt.z:.1f} from {nearest})"


def tilt_words(pose: BoardPose) -> str:
    """Return a board's tilt from the vertical, and its known tilt."""
    tilt = f"{np.degrees(pose.tilt()):.2f} deg"
    return tilt if pose.tilt_hypothesis is None else f"{tilt}, stand {member_words(pose)}"


def _board_to_json(seen: ObservedBoard, T_base_camera: Array) -> dict[str, Any]:
    value = pose_to_json(seen.pose, T_base_camera)
    for hole, occupancy in zip(value["holes"], seen.occupancy, strict=True):
        hole["state"] = occupancy.state
        if occupancy.state == "unsure":
            hole["reason"] = occupancy.reason
    return {"board": seen.name, "verdict": "accepted", "reasons": [], **value}


_TABLE = rule_of("a table", lambda v: isinstance(v, dict), lambda v: {str(k): str(w) for k, w in v.items()})
_LIST = rule_of("a list", lambda v: isinstance(v, list), lambda v: [str(one) for one in v])
_COVARIANCE = covariance_matrix(6)
LARGEST_REPEATABILITY = 2.0
"""In parts of the covariance. Both are estimates: of 116 single photographs with noise of 2 to 15 grey levels, the
largest was 0.71."""
_NUMBER = rule_of("a number", is_number, float)
_STATE: Rule[HoleState] = text(*get_args(HoleState))  # type: ignore[assignment]


def read_observation(path: Path, cell: Cell) -> Observation:
    """Read a look file, of images of this cell.

    Raises:
        FileInputError: the file is not a look file, has boards that the cell does not list, or was made with another
            pose or lens of the camera or other markers than the cell has now, by which its boards are displaced.
    """
    root = replace(Node.of_json(path, "look"), help="a465 look writes this file; look again")
    require_finite(path, root.value)
    scenes = root["scenes"].items()
    if not scenes:
        raise root["scenes"].error("must have a scene")
    if len(scenes) > 1:
        rule = f"has {len(scenes)} scenes; must have one: a plan is for one look"
        raise replace(root["scenes"], value=None).error(rule)
    if (
        scenes[0].get("lens", text(), cell.camera.lens_digest) != cell.camera.lens_digest
    ):  # older ones lack it
        rule = f"was made with other intrinsics than {cell.camera_file} has now: the poses of this look rest on them"
        raise FileInputError(path, "", None, rule, "look again")
    entries = scenes[0]["boards"].items()
    found = tuple(_board_from_json(entry, cell.boards) for entry in entries)
    names = [one.name for one in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise replace(scenes[0]["boards"], value=None).error(f"has board {twice[0]} a second time")
    for entry, seen in zip(entries, found, strict=True):
        _require_camera(scenes[0], entry, seen.pose.T_base_board, cell)
    missing = scenes[0].get("missing", _TABLE, {})
    half_seen = scenes[0].get("half_seen", _LIST, [])
    return Observation(found, missing, tuple(name for name in half_seen if name in missing))


def _board_from_json(entry: Node, boards: Sequence[Board]) -> ObservedBoard:
    ids = entry["marker_ids"]
    board = next((b for b in boards if list(b.marker_ids) == ids.value), None)
    if board is None:
        listed = ", ".join(str(list(one.marker_ids)) for one in boards) or "none"
        rule = f"is not a board of the cell file, which lists {listed}"
        raise ids.error(rule, "is this a look at another cell? look again")
    node = replace(entry, key=board.name)
    node["verdict"].read(text("accepted"))
    _require_markers(node, board)
    rows = node["T_base_board"].read(numbers((4, 4)))
    if np.abs(rows[:3, 3]).max() > _FARTHEST:
        rule = f"is a position in m; must be within {_FARTHEST:g} m of the base"
        raise replace(node["T_base_board"], value=rows[:3, 3].tolist()).error(rule, "is it in mm?")
    try:
        T_base_board = orthonormalised(rows)
    except A465Error as error:
        raise node["T_base_board"].error(str(error)) from error
    holes = node["holes"].items()
    if [hole["hole"].value for hole in holes] != [f"{board.name}/{n + 1}" for n in range(len(holes))]:
        raise node["holes"].error("must be in the order of the board's file")
    if len(holes) != len(board.holes):
        help = (
            f"the board of the cell has {len(board.holes)} holes: is this a look at another cell? look again"
        )
        raise node["holes"].error(f"must be {len(board.holes)}, each {_STATE.words}", help)
    covariance, repeatability = node["covariance"].read(_COVARIANCE), None
    if entry.value.get("repeatability") is not None:
        repeatability = node["repeatability"].read(_COVARIANCE)
        if exceeds(repeatability, LARGEST_REPEATABILITY * covariance):
            rule = f"must not exceed {LARGEST_REPEATABILITY:g} times the board's covariance in any direction"
            raise node["repeatability"].error(rule)
    pose = BoardPose(
        board,
        T_base_board,
        covariance,
        node["residual_px"].read(_NUMBER),
        node["hypothesis_ratio"].read(_NUMBER),
        _tilt_from_json(node),
        repeatability,
    )
    occupancy = (
        Occupancy(hole["state"].read(_STATE), reason=hole.get("reason", text(), "")) for hole in holes
    )
    return ObservedBoard(pose, tuple(occupancy))


def _require_markers(node: Node, board: Board) -> None:
    """Require the markers on which the pose of a look rests: their size, and where the second one is. A look of another
    program, and one from before these were kept, may lack them."""
    size, second = 1e3 * board.marker_size, 1e3 * np.array(board.second_marker)
    then = node.get("marker_size_mm", _NUMBER, size)
    if abs(then - size) > SAME_MM:
        rule = f"must be {size:g}, which the cell has for board {board.name} now: the poses of this look rest on it"
        raise node["marker_size_mm"].error(rule, "look again")
    if np.abs(node.get("second_marker_mm", numbers(2), second) - second).max() > SAME_MM:
        rule = f"must be [{second[0]:g}, {second[1]:g}], where the cell has the second marker of board {board.name} now"
        raise node["second_marker_mm"].error(rule, "look again")


def _require_camera(scene: Node, entry: Node, T_base_board: Array, cell: Cell) -> None:
    """Require that the camera of a look, which follows from a board in both frames, is where the cell has it.

    A look that was corrected for a shift of the camera is also right with the corrected pose, so it may differ by that.
    """
    if not isinstance(entry.value.get("T_camera_board"), list):  # made by another program
        return
    T = mul(T_base_board, inverse(entry["T_camera_board"].read(rigid())))
    now = cell.camera.T_base_camera
    off, turn = float(np.linalg.norm(T[:3, 3] - now[:3, 3])), angle_between(T[:3, :3], now[:3, :3])
    corrected, turned = 0.0, 0.0
    if isinstance(scene.value.get("camera"), dict):
        corrected = 1e-3 * scene["camera"].get("moved_mm", _NUMBER)
        turned = float(np.radians(np.linalg.norm(scene["camera"].get("rotation_deg", numbers(3)))))
    if off > CAMERA_OFF + corrected or turn > CAMERA_TURNED + turned:
        raise FileInputError(
            scene.file,
            "",
            None,
            f"was made with another camera pose than {cell.file} has now: they differ by {1e3 * off:.2f} mm and "
            f"{np.degrees(turn):.3f} deg",
            "look again",
        )


def _tilt_from_json(board: Node) -> TiltHypothesis | None:
    if board.value.get("tilt_hypothesis") is None:
        return None
    tilt = board["tilt_hypothesis"]
    nearest, z, probability = (tilt[key].read(_NUMBER) for key in ("nearest_deg", "z", "probability"))
    return TiltHypothesis(float(np.radians(nearest)), z, probability, tilt["fits"].read(flag()))


_FORMER = {"Seen": "Observation", "SeenBoard": "ObservedBoard", "read_seen": "read_observation"}
former_names(__name__, __name__, **_FORMER, seen_to_json="observation_to_json")
