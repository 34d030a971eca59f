"""The collection as a command: open the cell, take the poses, calibrate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.files import keep_apart
from calib.hand_eye import HAND_EYE_LIMITS
from cell.applying import apply_calibration
from cell.calibratechain import limits_of, report_beside, require_files, solve_hand_eye
from cell.collecting import CollectOptions, Collector
from cell.console import Console
from cell.handtarget import read_hand_target
from cell.run import opened
from cell.taskfile import read_task
from driver.control import Control


def collect_step(
    recording: Path,
    task_file: Path,
    target_file: Path,
    output: Path | None,
    report: Path | None,
    apply: bool,
    options: CollectOptions,
    limit_mm: float | None,
    port: str | None,
    world: Path | None,
    camera: str | None,
    speed: float | None,
    time_scale: float | None,
    folder: Path | None,
    console: Console,
) -> dict[str, Any]:
    """Record the target in the arm's hand and calibrate; both files are written as soon as they can be.

    Args:
        apply: let the task's cell file name the calibration, if it is accepted.

    Raises:
        InputError: a file, value or port is wrong.
        ImpossibleError: the target cannot be shown to the camera, or is not seen.
        ExecutionStopped: motion stopped; the same command goes on from what was recorded.
        CalibrationRefused: nothing could be computed.
    """
    task, hand = read_task(task_file), read_hand_target(target_file)
    limits = limits_of(HAND_EYE_LIMITS, limit_mm)
    if apply and output is None:
        raise InputError(
            "--apply needs -o FILE: the calibration file that the cell is to name", option="--apply"
        )
    keep_apart(recording, task_file, target_file, task.cell.file)
    report = report_beside(output, report)
    inputs = (recording, task_file, target_file, task.cell.file, task.cell.camera_file)
    keep_apart(output, *inputs)
    keep_apart(report, *inputs)
    require_files(output, report)
    speed = task.cell.speed if speed is None else speed
    task.cell.limits.scaled(speed)
    if port is None and recording.suffix != ".json":
        raise InputError(f"{recording}: a recording is a .json file", file=str(recording))
    with opened(task, console, port, world, None, camera, speed, time_scale, folder, Control()) as run:
        if run.connection.simulated is not None:
            run.connection.simulated.in_hand = hand.roughly_mounted(run.connection.simulated.world.seed)
        collector = Collector(run, hand, recording, options, console)
        collector.take_into_use()
        collector.home()
        taken = collector.collect()
        collector.home()
        console.step(f"{taken} poses taken, {len(collector.joints)} in {recording}")
    result = solve_hand_eye(
        recording, collector.recording(), task.cell.unit.name, output, report, limits, None, console
    )
    if apply and output is not None and not result["reasons"]:
        line = apply_calibration(task.cell.file, output)
        console.say(f"{task.cell.file} says now: {line}")
    return {**result, "recording": str(recording), "folder": str(run.folder)}
