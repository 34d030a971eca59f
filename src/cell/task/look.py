"""Take images of the cell, find boards and cubes in them, and save a picture of the detections."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2

from arm.board import Board
from arm.errors import ImpossibleError, InputError
from arm.io.storage import write_atomic
from cell.config.cell import Cell
from cell.console import Console
from cell.files.observation import Seen, SeenBoard
from cell.files.task import Task
from vision.camera.frame_source import FrameSource
from vision.camera.model import Image
from vision.markers.detect import Marker, detect_markers
from vision.markers.exposure import exposure_complaint
from vision.observe import Look, annotated, look
from vision.occupancy.seated import CubeWidth, Sight


def look_and_save(
    task: Task,
    frames: FrameSource,
    picture: Path | None,
    console: Console,
    why: str,
    arm_in_view: bool = False,
) -> Seen:
    """Take images of the cell, find boards and cubes, and write the first image with detections drawn in.

    Args:
        arm_in_view: see `vision.observe.look`.

    Raises:
        InputError: an image has the wrong size, or shows a marker that belongs to no board of the cell.
    """
    cell = task.cell
    images = frames.grab(cell.photographs)
    try:
        found = look(
            images,
            cell.camera,
            cell.boards,
            cell.dictionary,
            cell.cube_size,
            cell.board_limits,
            arm_in_view,
            cell.tilts,
        )
    except ImpossibleError:  # the image and its markers help to find the cause
        markers = tuple(detect_markers(images[0], cell.camera, cell.dictionary))
        _complain(images[0], markers, console)
        if picture is not None:
            write_png(picture, annotated(images[0], cell.camera, Look((), {}, (markers,))))
        raise
    if picture is not None:
        write_png(picture, annotated(images[0], cell.camera, found))
    sight = Sight(images, cell.camera, nominal_width(cell), cell.boards[0].pocket)
    seen = replace(seen_of(found, cell.boards), sight=sight)
    boards = ", ".join(
        f"{b.name} ({len(b.holes('cube'))} cubes, {b.pose.residual_px:.3f} px)" for b in seen.boards
    )
    console.step(f"look {why}: {boards or 'no board'}")
    for board in seen.boards:
        for hole in board.holes("unsure"):
            console.say(f"hole {board.name}/{hole + 1} is unsure: {board.doubts[hole]}")
    _complain(images[0], found.frames[0], console)
    return seen


def nominal_width(cell: Cell) -> CubeWidth:
    """Width of an unmeasured cube: the cell file's, within its tolerance (two standard deviations)."""
    return CubeWidth(cell.cube_size, cell.cube_tolerance / 2.0)


def _complain(image: Image, markers: Sequence[Marker], console: Console) -> None:
    complaint = exposure_complaint(image, markers)
    if complaint is not None:
        console.say(f"WARNING: the images are {complaint}")


def seen_of(found: Look, known: Sequence[Board]) -> Seen:
    """Convert a `vision.observe.Look` for the cell's commands; `known`: all boards of the cell."""
    boards = tuple(
        SeenBoard(b.pose, tuple(o.state for o in b.occupancy), tuple(o.reason for o in b.occupancy))
        for b in found.boards
    )
    seen_ids = {marker.id for frame in found.frames for marker in frame}
    half = tuple(b.name for b in known if b.name in found.missing and seen_ids & set(b.marker_ids))
    return Seen(boards, dict(found.missing), half)


def write_png(path: Path, image: Image) -> None:
    """Write an image completely or not at all.

    Raises:
        InputError: it cannot be encoded or written.
    """
    good, data = cv2.imencode(".png", image)
    if not good:
        raise InputError(f"{path}: this image cannot be written as PNG", file=str(path))
    write_atomic(path, data.tobytes())
