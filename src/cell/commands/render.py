"""``a465 render TASK --target``: images of a calibration target before the cell's camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from cell.console import Console
from cell.files.task import read_task
from cell.sim.target_photos import photograph_target, random_poses
from cell.task.look import write_png
from vision.targets.target import Target, read_target

DEFAULT_COUNT = 20


def target_step(
    task_file: Path, target_file: str, seed: int, output: Path, count: int | None, console: Console
) -> dict[str, Any]:
    """Write images in which the target covers the field of view, as for a lens calibration.

    Args:
        task_file: task file with the cell.
        target_file: target file, or "charuco" for the default one.
        seed: seed of the poses and the noise.
        output: folder of the images.
        count: number of images; None: `DEFAULT_COUNT`.
        console: output.

    Raises:
        InputError: a file, the count or the seed is wrong.
    """
    wanted = DEFAULT_COUNT if count is None else count
    if not 1 <= wanted <= 1000:
        raise InputError(f"count = {wanted}: must be from 1 to 1000", count=wanted)
    if seed < 0:
        raise InputError(f"--seed {seed}: must be 0 or more", seed=seed)
    target = Target() if target_file == "charuco" else read_target(Path(target_file))
    camera = read_task(task_file).cell.camera
    rng = np.random.default_rng(seed)
    names = []
    for number, T in enumerate(random_poses(camera, target, rng, wanted), start=1):
        console.progress("images of the target", (number - 1) / wanted)
        path = output / f"target-{number:03d}.png"
        write_png(path, photograph_target(camera, target, T, rng))
        names.append(str(path))
    console.say(f"{len(names)} images of {target.label()} written to {output}")
    return {"photographs": names}
