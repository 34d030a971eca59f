"""``a465 render``: images of the simulated cell, or of a calibration target before its camera."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from cell.console import Console
from cell.files.task import read_task
from cell.session.connection import camera_at_start
from cell.sim.target_photos import photograph_target, random_poses
from cell.task.look import write_png
from vision.camera.frame_source import Image
from vision.targets.target import Target, read_target

TARGET_IMAGES = 20  # default number


def render_step(
    task_file: Path, world: Path | None, output: Path, count: int | None, console: Console
) -> dict[str, Any]:
    """Write images of the simulated cell with the arm at q_start.

    Args:
        task_file: task file with the cell.
        world: ground truth; None: the world file beside the task file.
        output: folder of the images.
        count: number of images; None: that of a look.
        console: output.

    Raises:
        InputError: a file or the count is wrong.
    """
    task = read_task(task_file)
    wanted = _count(count, task.cell.photographs)
    return _write(camera_at_start(task, world).grab(wanted), wanted, output / "photograph", "", console)


def target_step(
    task_file: Path, target_file: str, seed: int, output: Path, count: int | None, console: Console
) -> dict[str, Any]:
    """Write images in which a target covers the field of view, as for a lens calibration.

    Args:
        task_file: task file with the cell.
        target_file: target file, or "charuco" for the default one.
        seed: seed of the poses and the noise.
        output: folder of the images.
        count: number of images; None: `TARGET_IMAGES`.
        console: output.

    Raises:
        InputError: a file, the count or the seed is wrong.
    """
    wanted = _count(count, TARGET_IMAGES)
    if seed < 0:
        raise InputError(f"--seed {seed}: must be 0 or more", seed=seed)
    target = Target() if target_file == "charuco" else read_target(Path(target_file))
    camera, rng = read_task(task_file).cell.camera, np.random.default_rng(seed)
    images = (photograph_target(camera, target, T, rng) for T in random_poses(camera, target, rng, wanted))
    return _write(images, wanted, output / "target", f" of {target.label()}", console)


def _count(count: int | None, usual: int) -> int:
    wanted = usual if count is None else count
    if not 1 <= wanted <= 1000:
        raise InputError(f"count = {wanted}: must be from 1 to 1000", count=wanted)
    return wanted


def _write(images: Iterable[Image], wanted: int, stem: Path, what: str, console: Console) -> dict[str, Any]:
    """Write numbered images; return the object for ``--json``."""
    names = []
    for number, image in enumerate(images, start=1):
        console.progress(f"images{what}", (number - 1) / wanted)
        path = stem.with_name(f"{stem.name}-{number:03d}.png")
        write_png(path, image)
        names.append(str(path))
    console.say(f"{len(names)} images{what} written to {stem.parent}")
    return {"photographs": names}
