"""Additions to the page of a plan: boards with holes and markers, camera, clearance, executed motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.board import POCKET_DEPTH, Board, plate_name
from arm.robot.shapes import Body, Convex, Shape, hull_faces, shape_to_json
from arm.se3 import Array, inverse
from cell.preview.photograph import photograph_url
from vision.camera.model import Camera, Image
from vision.markers.dictionaries import marker_modules

_DIGITS = 7  # of lengths in m: a tenth of a micrometre


@dataclass(frozen=True)
class ClearanceSample:
    """The closest pair of bodies at one time of a move.

    Attributes:
        time_s: since the move's start.
        distance: m.
        pair: names of the two bodies.
        points: the nearest points, (2, 3) m in the base frame, in the order of the names.
    """

    time_s: float
    distance: float
    pair: tuple[str, str]
    points: Array


@dataclass(frozen=True)
class ExecutedMove:
    """Executed motion during one step of the plan.

    Attributes:
        step: index into the plan's steps.
        time_s: (m,) since the step's start.
        counts: (m, 6) encoder counts.
    """

    step: int
    time_s: Array
    counts: Array


@dataclass(frozen=True)
class Refused:
    """Why a motion is refused; the page opens there, with the two bodies in red.

    Attributes:
        what: in words.
        time_s: from the plan's start.
        pair: names of the two bodies; none if no two bodies are the cause.
    """

    what: str
    time_s: float
    pair: tuple[str, ...] = ()


def pose_numbers(T: Array) -> list[float]:
    """Return the upper three rows of a 4x4 transform, row by row, rounded to 0.1 um."""
    return [float(v) + 0.0 for v in np.round(T[:3], _DIGITS).ravel()]


def shape_numbers(shape: Shape) -> dict[str, Any]:
    """Return a shape for the page; a hull includes its triangles as indices of its points."""
    if isinstance(shape, Convex):
        points = np.round(shape.points, _DIGITS) + 0.0
        return {"convex": points.tolist(), "faces": hull_faces(shape).corners.tolist()}
    return shape_to_json(shape)


def marker_rows(dictionary: str, marker_id: int) -> list[str]:
    """Return a marker's modules with its black border, top row first, ``1`` for white.

    Raises:
        InputError: OpenCV has no such dictionary, or the dictionary has no such marker.
    """
    modules = marker_modules(dictionary, marker_id)
    return ["".join("1" if white else "0" for white in row) for row in modules]


def board_to_json(board: Board, T_base_board: Array, dictionary: str) -> dict[str, Any]:
    """Return a board for the page, drawn in place of its plate, lengths in m."""
    return {
        "name": board.name,
        "body": plate_name(board.name),
        "T": pose_numbers(T_base_board),
        "plate": {"size": list(board.plate.size), "centre": list(board.plate.centre)},
        "pocket": {"mouth": board.pocket[0], "floor": board.pocket[1], "depth": POCKET_DEPTH},
        "holes": [[float(x), float(y)] for x, y, _ in board.holes],
        "markers": [
            {
                "rows": marker_rows(dictionary, marker_id),
                "size": board.marker_size,
                "centre": [float(v) for v in corners.mean(axis=0)[:2]],
            }
            for marker_id, corners in zip(board.marker_ids, board.marker_corners(), strict=True)
        ],
    }


def boards_to_json(boards: Sequence[Board], bodies: Sequence[Body], dictionary: str) -> list[dict[str, Any]]:
    """Return those of `boards` whose plates are among `bodies`, at the plates' poses."""
    plates = {body.name: body.T_base_body for body in bodies}
    return [
        board_to_json(board, plates[plate_name(board.name)] @ inverse(board.plate.T_board_plate), dictionary)
        for board in boards
        if plate_name(board.name) in plates
    ]


def camera_to_json(camera: Camera, photograph: Image | None) -> dict[str, Any]:
    """Return the camera's pose, the rays through its image corners at depth 1 m, and what it took.

    Rays and photograph are without the lens's distortion.

    Raises:
        InputError: the photograph has not the camera's size.
    """
    width, height = camera.size
    pixels = np.array([[0, 0, 1], [width, 0, 1], [width, height, 1], [0, height, 1]], dtype=float)
    rays = pixels @ np.linalg.inv(camera.K).T
    taken = None if photograph is None else photograph_url(camera, photograph)
    corners = np.round(rays, 5).tolist()
    return {"T": pose_numbers(camera.T_base_camera), "corners": corners, "photograph": taken}


def clearance_to_json(samples: Sequence[ClearanceSample]) -> dict[str, Any]:
    """Return the clearance over one move, in columns; distances and points in m."""
    names = sorted({name for s in samples for name in s.pair})
    place = {name: i for i, name in enumerate(names)}
    return {
        "time": [round(s.time_s, 4) for s in samples],
        "distance": [round(s.distance, 6) for s in samples],
        "names": names,
        "pairs": [[place[name] for name in s.pair] for s in samples],
        "points": [np.round(s.points, 5).ravel().tolist() for s in samples],
    }


def executed_to_json(move: ExecutedMove) -> dict[str, Any]:
    """Return one executed move, in columns; whole counts."""
    return {
        "step": move.step,
        "time": np.round(move.time_s, 6).tolist(),  # at 100 deg/s that is 0.0001 deg
        "counts": np.rint(move.counts).astype(int).tolist(),
    }
