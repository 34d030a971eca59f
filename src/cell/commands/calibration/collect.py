"""``a465 calibrate hand-eye --collect``: open the cell, choose the poses, record them, calibrate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import ExecutionStopped, InputError
from arm.io.outputs import keep_apart
from arm.se3 import Array
from cell.collect.collector import CollectOptions, Collector, choose_poses, hand_scene
from cell.collect.record import CHANGED, HandRecord
from cell.collect.sway import Sway
from cell.commands.calibration.background import background_after_hand_eye
from cell.commands.calibration.chain import ChainOptions, solve_hand_eye, without_calibration
from cell.commands.run import Confirm, opened
from cell.console import Console
from cell.files.hand_target import read_hand_target
from cell.files.task import Task, read_task
from cell.session.connection import WhichCell
from cell.session.speed import planning_speed
from cell.task.run import TaskRun
from driver.execution.control import Control
from vision.camera.model import Image


@dataclass(frozen=True)
class CollectFiles:
    """Files that a collection reads and writes.

    Attributes:
        recording: recording to start or continue.
        task: task file with the cell.
        target: file of the target in the gripper.
        folder: folder for plans and the wire log; None: a new one.
        apply: enter an accepted calibration in the task's cell file.
    """

    recording: Path
    task: Path
    target: Path
    folder: Path | None = None
    apply: bool = False


def collect_step(
    files: CollectFiles,
    poses: CollectOptions,
    options: ChainOptions,
    where: WhichCell,
    console: Console,
    confirm: Confirm | None = None,
) -> dict[str, Any]:
    """Record the target in the gripper and calibrate. The recording is written after each pose.

    Nothing moves if the recording is complete. A calibration in the cell file that cannot be used is ignored: this
    command creates it.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: the target cannot be shown to the camera, or is not detected.
        ExecutionStopped: motion stopped; the same command continues the recording.
        CalibrationRefused: nothing could be computed.
    """
    recording = files.recording
    task = read_task(files.task, without_calibration(console))
    hand = read_hand_target(files.target)
    if files.apply and options.output is None:
        why = "--apply needs -o FILE, the calibration file to enter in the cell file"
        raise InputError(why, option="--apply")
    if recording.suffix != ".json":
        raise InputError(f"{recording}: the name of a recording must end in .json", file=str(recording))
    world = where.world or task.file.with_suffix(".world.toml")
    read = (files.task, files.target, task.cell.file, task.cell.camera_file, world)
    keep_apart(recording, *read, kind="recording")
    options = replace(options.checked_all((recording, *read)), cell=task.cell.file, apply=files.apply)
    record = HandRecord(recording, task.cell, hand)
    folder, pool = None, None
    images: list[Image] = []
    if len(record) < poses.poses:
        pool, folder, images = _add(task, record, poses, files.folder, where, console, confirm)
    else:
        console.step(f"{recording}: has {len(record)} poses already, so nothing moves")
    with console.doing("calibrating"):
        result = solve_hand_eye(recording, record.recording(), options, console, pool, task.cell)
    if images and files.apply and options.output is not None and not result["reasons"]:
        background_after_hand_eye(files.task, images, options.output.with_suffix(".background.npz"), console)
    return {**result, "recording": str(recording), "folder": None if folder is None else str(folder)}


def _add(
    task: Task,
    record: HandRecord,
    options: CollectOptions,
    folder: Path | None,
    where: WhichCell,
    console: Console,
    confirm: Confirm | None,
) -> tuple[Array, Path, list[Image]]:
    """Record the missing poses.

    Returns:
        Readings (n, 6), rad, at which the target can be shown; the run folder; images of the cell with the arm at
        q_start, empty if a person puts images into a folder.

    Choosing the poses takes long. So it begins when the cell is open and the unit has reported whether it kept its
    positions, and ends before a person is asked to confirm, because the arm moves right after that.
    """
    if len(record):
        console.step(f"{record.file}: continuing with {len(record)} recorded poses")
    scene = hand_scene(record)
    by_hand = where.images is not None
    sway = None if by_hand else Sway(record.file.with_suffix(".background.npz"), task.cell, console)
    choices: list[tuple[Array, Array]] = []

    def choose_and_confirm(run: TaskRun) -> None:
        choices.append(choose_poses(record, scene, options, console))
        if confirm is not None:
            confirm(run)

    speed = planning_speed(task.cell, where.speed)
    try:
        with opened(task, console, where, speed, folder, Control(), choose_and_confirm) as run:
            if run.connection.simulated is not None:
                run.connection.simulated.hold(record.hand)
            collector = Collector(run, record, scene, sway, console)
            collector.initialise_arm()
            collector.begin_sway()
            if len(record):
                collector.require_same_hold()
            ((wanted, pool),) = choices
            taken = collector.collect(wanted, nearest_first=not options.recipe)
            collector.home()
            images = [] if by_hand else list(collector.photographs())
            if sway is not None:
                sway.report()
    except ExecutionStopped as error:
        if not len(record) or error.data.get("reason") == CHANGED:
            raise
        why = f"{error}; {len(record)} poses are in {record.file}, and the same command continues from them"
        raise ExecutionStopped(why, **error.data) from error
    console.step(f"{taken} poses recorded, {len(record)} in {record.file}")
    return np.array([record.to_readings(q) for q in pool]), run.folder, images
