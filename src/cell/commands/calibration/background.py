"""``a465 calibrate background``: take the background that later looks compare the camera with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.storage import keep_apart
from cell.commands.steps import frames_of
from cell.console import Console
from cell.files.apply_calibration import apply_calibration, name_in, naming
from cell.files.task import read_task
from cell.session.cameras import require_one_camera
from cell.task.camera_watch import take_background
from vision.background.features import write_background


@dataclass(frozen=True)
class BackgroundSource:
    """Where the images of the background come from: one of a folder, a camera, and the simulated cell."""

    images: Path | None = None
    camera: str | None = None
    world: Path | None = None


def background_step(
    task_file: Path, source: BackgroundSource, output: Path, apply: bool, console: Console
) -> dict[str, Any]:
    """Take the background of a task's cell, write it, and enter it in the cell file if asked to.

    Raises:
        InputError: a file, value or source of images is wrong.
        ImpossibleError: too few features are seen, or a board's pose is unknown.
    """
    require_one_camera(source.images, source.camera)
    keep_apart(output, task_file, source.world)
    if output.suffix != ".npz":
        raise InputError(f"-o {output}: must end in .npz", option="--output", value=str(output))
    task = read_task(task_file)
    with frames_of(task, source.images, source.camera, source.world) as frames:
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
