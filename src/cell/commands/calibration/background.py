"""``a465 calibrate background``: take the background that later looks compare the camera with."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.errors import A465Error, InputError
from arm.io.outputs import keep_apart
from cell.commands.steps import frames_of
from cell.console import Console
from cell.files.apply_calibration import apply_calibration, name_in, naming
from cell.files.task import read_task
from cell.session.camera_watch import take_background
from cell.session.cameras import require_one_camera
from vision.background.features import write_background
from vision.camera.model import Image


def background_step(
    task_file: Path,
    output: Path,
    apply: bool,
    console: Console,
    images: Path | None = None,
    camera: str | None = None,
    world: Path | None = None,
) -> dict[str, Any]:
    """Take the background of a task's cell, write it, and enter it in the cell file if asked to.

    The images come from one of a folder, a camera, and the simulated cell.

    Raises:
        InputError: a file, value or source of images is wrong.
        ImpossibleError: too few features are seen, or a board's pose is unknown.
    """
    require_one_camera(images, camera)
    keep_apart(output, task_file, world)
    if output.suffix != ".npz":
        raise InputError(f"-o {output}: must end in .npz", option="--output", value=str(output))
    task = read_task(task_file)
    with frames_of(task, images, camera, world) as frames:
        background, seen = take_background(task.cell, frames.grab(task.cell.photographs))
    write_background(output, background)
    boards = ", ".join(b.name for b in seen.boards)
    console.say(
        f"{len(background.points)} features of the background written to {output}"
        + (f"; boards {boards} and what is near them are left out" if boards else "")
    )
    if apply:
        console.say(f"{task.cell.file} now has: {apply_calibration(task.cell.file, output, 'background')}")
    else:
        line = naming(name_in(task.cell.file, output), "background")
        console.say(f"to use it, add to {task.cell.file}: {line}")
    return {"background": str(output), "features": len(background.points), "applied": apply}


def background_after_hand_eye(
    task_file: Path, images: Sequence[Image], output: Path, console: Console
) -> None:
    """Write the background that belongs to the calibration that was just applied, and enter it in the cell file.

    A table that shows too little is no reason to give up a calibration, so that is only reported.
    """
    task = read_task(task_file)
    try:
        background, _ = take_background(task.cell, images)
        write_background(output, background)
        line = apply_calibration(task.cell.file, output, "background")
    except A465Error as error:
        console.say(f"no background was recorded, so a camera that moves is not noticed: {error}")
    else:
        console.say(f"{task.cell.file} now has: {line} ({len(background.points)} features)")
