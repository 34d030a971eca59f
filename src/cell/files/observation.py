"""The result of a look and its file: board poses, holes and cubes, as the JSON of ``a465 look``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.board import Board
from arm.errors import A465Error, FileInputError, ImpossibleError
from arm.io.storage import read_json, require_finite
from arm.numerics.products import mul
from arm.poses import BoardPose, TiltHypothesis
from arm.se3 import Array, frozen, inverse, orthonormalised
from cell.config.cell import Cell
from cell.files.board_shift import board_shift
from cell.files.task import Task
from vision.occupancy.seated import Sight

HEIGHT_TOLERANCE = 0.010  # between the stated and the detected height of Task 1's board, m
FLAT_TOLERANCE = np.radians(2.0)


@dataclass(frozen=True)
class SeenBoard:
    """A detected board.

    Attributes:
        pose: its pose.
        occupancy: state per hole: cube, empty or unsure.
        doubts: per hole, the reason for unsure; else empty.
    """

    pose: BoardPose
    occupancy: tuple[str, ...]
    doubts: tuple[str, ...] = ("",) * 4

    @property
    def name(self) -> str:
        """Name of the board."""
        return self.pose.board.name

    def holes(self, *states: str) -> tuple[int, ...]:
        """Return the holes (0 to 3) in one of these states."""
        return tuple(i for i, state in enumerate(self.occupancy) if state in states)


@dataclass(frozen=True)
class Seen:
    """The boards detected in one look, and why others were not.

    Attributes:
        boards: detected boards.
        missing: per board name, the reason why it was not detected.
        half_seen: names of missing boards that are partly in view, so that their pose is unknown.
        sight: images for measuring cubes; None for a look that was read from a file.
        moved_since: places that cubes left or reached after the images were taken.
    """

    boards: tuple[SeenBoard, ...]
    missing: dict[str, str]
    half_seen: tuple[str, ...] = ()
    sight: Sight | None = field(default=None, compare=False, repr=False)
    moved_since: frozenset[str] = field(default=frozenset(), compare=False)

    @property
    def poses(self) -> tuple[BoardPose, ...]:
        """Poses of the detected boards."""
        return tuple(b.pose for b in self.boards)

    def board(self, name: str) -> SeenBoard | None:
        """Return the board of that name, or None if it was not detected."""
        return next((b for b in self.boards if b.name == name), None)

    def missing_of(self, task: Task) -> list[str]:
        """Return the names of the task's boards that were not detected."""
        return [b.name for b in task.boards if self.board(b.name) is None]

    def cubes_in(self) -> dict[str, tuple[int, ...]]:
        """Return per board the holes that hold or may hold a cube: every hole that is not surely empty."""
        return {b.name: b.holes("cube", "unsure") for b in self.boards}

    def state(self, place: str) -> str | None:
        """Return the state of a hole such as ``01-02/3``, or None if its board was not detected or it is no hole."""
        name, _, number = place.rpartition("/")
        board = self.board(name)
        return None if board is None else board.occupancy[int(number) - 1]

    def with_moves(self, moves: Mapping[str, str]) -> Seen:
        """Return the expected look after moves of cubes, named by their hole, to places."""
        states = {cube.removeprefix("cube "): "empty" for cube in moves} | dict.fromkeys(
            moves.values(), "cube"
        )
        boards = tuple(
            replace(b, occupancy=tuple(states.get(f"{b.name}/{i + 1}", s) for i, s in enumerate(b.occupancy)))
            for b in self.boards
        )
        return replace(self, boards=boards, moved_since=self.moved_since | states.keys())

    def changed(self, expected: Seen) -> list[str]:
        """Describe the holes whose state surely differs from the expected one, one line per hole."""
        lines = []
        for board in self.boards:
            for number, state in enumerate(board.occupancy, start=1):
                was = expected.state(f"{board.name}/{number}")
                if was not in (None, state, "unsure") and state != "unsure":
                    lines.append(f"hole {board.name}/{number} looks {state}, not {was}")
        return lines

    def require(self, task: Task) -> None:
        """Require that the task's boards were detected, at poses that the task allows.

        Raises:
            ImpossibleError: names the board and the reason.
        """
        for board in task.boards:
            seen = self.board(board.name)
            if seen is None:
                why = self.missing.get(board.name, "its markers are not in the image")
                raise ImpossibleError(
                    f"board {board.name} was not found: {why}; move it completely into the camera's view",
                    board=board.name,
                    why=why,
                )
        if self.half_seen:
            name = self.half_seen[0]
            raise ImpossibleError(
                f"board {name} is partly in view, so its pose is unknown: {self.missing[name]}; move it completely "
                "into the camera's view, or out of the cell",
                board=name,
                why=self.missing[name],
            )
        if task.board_height is not None:
            _require_flat(task, self.board(task.from_board.name))

    def moved(self, before: Seen, cell: Cell) -> list[str]:
        """Describe the boards that moved beyond the cell's tolerance since `before`, one line per board."""
        lines = []
        lines += [f"board {b.name} has come into view" for b in self.boards if before.board(b.name) is None]
        for old in before.boards:
            new = self.board(old.name)
            if new is None:
                lines.append(f"board {old.name} is no longer in view")
                continue
            shift = board_shift(old.pose.board, cell.cube_size, old.pose.T_base_board, new.pose.T_base_board)
            if shift.beyond(cell):
                lines.append(f"board {old.name} moved by {shift}")
        return lines


def _require_flat(task: Task, seen: SeenBoard | None) -> None:
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


def seen_to_json(seen: Seen, T_base_camera: Array) -> dict[str, Any]:
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


def _board_to_json(seen: SeenBoard, T_base_camera: Array) -> dict[str, Any]:
    value = pose_to_json(seen.pose, T_base_camera)
    for hole, state in zip(value["holes"], seen.occupancy, strict=True):
        hole["state"] = state
    for number in seen.holes("unsure"):
        value["holes"][number]["reason"] = seen.doubts[number]
    return {"board": seen.name, "verdict": "accepted", "reasons": [], **value}


def read_seen(path: Path, boards: Sequence[Board]) -> Seen:
    """Read a look file.

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
        return Seen(tuple(found), missing, tuple(name for name in half_seen if name in missing))
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


def _board_from_json(path: Path, entry: dict[str, Any], boards: Sequence[Board]) -> SeenBoard:
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
    doubts = tuple(str(hole.get("reason", "")) for hole in entry["holes"])
    pose = BoardPose(
        board,
        T_base_board,
        covariance,
        float(entry["residual_px"]),
        float(entry["hypothesis_ratio"]),
        _tilt_from_json(entry.get("tilt_hypothesis")),
    )
    return SeenBoard(pose, states, doubts)
