"""Grab images of the cell, detect boards and cubes in them, and save a picture of the detections."""

from __future__ import annotations

from collections.abc import Set
from pathlib import Path

import cv2

from arm.errors import ImpossibleError, InputError
from arm.io.storage import write_atomic
from cell.accuracy.measures import Budgets
from cell.accuracy.placement import PlacementBudget
from cell.accuracy.reach_budgets import reach_budgets
from cell.config.cell import Cell
from cell.console import Console
from cell.files.task import Task
from cell.scene.places import reach_of
from cell.session.camera_watch import camera_watch, look_in, shift_words
from cell.task.planning import Rest, request_of, without_holes
from plan.cartesian.reachability import ReachTable
from vision.camera.frame_source import FrameSource
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers
from vision.markers.exposure import exposure_complaint
from vision.observation import Observation, ObservedBoard
from vision.observe import annotated


def look_and_save(
    task: Task,
    frames: FrameSource,
    picture: Path | None,
    console: Console,
    why: str,
    arm_in_view: bool = False,
    photographs: int | None = None,
) -> Observation:
    """Grab images of the cell, detect boards and cubes, and write the first image with the detections drawn in.

    Args:
        task: with the cell.
        frames: the camera.
        picture: file to write; None: none.
        console: for output.
        why: purpose of the look, for the console.
        arm_in_view: see `vision.observe.look`.
        photographs: number of images; None: the cell file's.

    Raises:
        InputError: an image has the wrong size, or shows a marker that belongs to no board of the cell.
    """
    cell = task.cell
    images = frames.grab(photographs or cell.photographs)
    try:
        observation = look_in(cell, images, arm_in_view, camera_watch(cell))
    except ImpossibleError:  # the image and its markers help to find the cause
        markers = tuple(detect_markers(images[0], cell.camera, cell.dictionary))
        observation = Observation(images=tuple(images), frames=(markers,))
        _complain(observation, console)
        _draw(picture, cell.camera, observation)
        raise
    _draw(picture, cell.camera, observation)
    boards = ", ".join(map(_words, observation.boards))
    console.step(f"look {why}: {boards or 'no board'}")
    if (moved := shift_words(observation.camera_shift)) is not None:
        console.step(moved)
    for board in observation.boards:
        for hole in board.holes("unsure"):
            console.say(f"hole {hole.name} is unsure: {board.occupancy[hole.index].reason}")
    _complain(observation, console)
    return observation


def _words(board: ObservedBoard) -> str:
    cubes = f"{len(board.holes('cube'))} cubes, " if board.occupancy else ""
    return f"{board.name} ({cubes}{board.pose.residual_px:.3f} px)"


def _complain(observation: Observation, console: Console) -> None:
    complaint = exposure_complaint(observation.images[0], observation.frames[0])
    if complaint is not None:
        console.warn(f"the images are {complaint}", "exposure")


def _draw(picture: Path | None, camera: Camera, observation: Observation) -> None:
    if picture is not None:
        write_png(picture, annotated(observation.images[0], camera, observation))


def write_png(path: Path, image: Image) -> None:
    """Write an image completely or not at all.

    Raises:
        InputError: it cannot be encoded or written.
    """
    good, data = cv2.imencode(".png", image)
    if not good:
        raise InputError(f"{path}: this image cannot be written as PNG", file=str(path))
    write_atomic(path, data.tobytes())


def foreseen(task: Task, seen: Observation, table: ReachTable | None = None) -> Budgets:
    """Return how sure each placement of a task would be, before there is a plan.

    Args:
        task, seen: with all boards of the task.
        table: reach of the holes; None: it is computed.
    """
    found = table or reach_of(task, seen)

    def of(cell: Cell, look: Observation) -> tuple[PlacementBudget, ...]:
        return reach_budgets(cell, look, task.from_board, task.to_board, found)

    def again(look: Observation, without: Set[str]) -> tuple[PlacementBudget, ...]:
        other = without_holes(task, without)
        request_of(Rest(other, look, task.cell.q_start, task.cell.speed))  # are there places enough?
        return reach_budgets(task.cell, look, task.from_board, task.to_board, reach_of(other, look))

    return Budgets(of, again)
