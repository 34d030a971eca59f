"""``a465 render``: images of the simulated cell, or of a calibration target before its camera."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from arm.errors import InputError
from cell.console import Console
from cell.files.task import read_task
from cell.session.connection import camera_at_start, target_camera
from cell.sim.target_photos import random_poses
from cell.task.look import write_png
from vision.camera.frame_source import IMAGE_SUFFIXES, Image, require_folder_name
from vision.targets.target import Target, read_target

TARGET_IMAGES = 20  # default number


def render_step(
    task_file: Path,
    world: Path | None,
    output: Path,
    count: int | None,
    console: Console,
    target_file: str | None = None,
    seed: int = 0,
) -> dict[str, Any]:
    """Write images of the simulated cell with the arm at q_start, or of a target as for a lens calibration.

    The arguments are the options of the command (`cell.cli.tools.render`). A target is one that covers the field of
    view; the default `count` is that of a look, or `TARGET_IMAGES`.

    Raises:
        InputError: a file, the count or the seed is wrong.
    """
    if count is not None and not 1 <= count <= 1000:
        raise InputError(f"--count {count}: must be from 1 to 1000", count=count)
    if seed < 0:
        raise InputError(f"--seed {seed}: must be 0 or more", seed=seed)
    if output.is_file():
        raise InputError(f"-o {output}: is a file; give a folder for the images", file=str(output))
    require_folder_name(output)
    task = read_task(task_file)
    if target_file is None:
        wanted = count or task.cell.photographs
        images: Iterable[Image] = camera_at_start(task, world).grab(wanted)
        return _write(images, wanted, output / "photograph", "", console)
    target = Target() if target_file == "charuco" else read_target(Path(target_file))
    rng, wanted = np.random.default_rng(seed), count or TARGET_IMAGES
    camera = target_camera(task, world, rng)
    images = (camera.photograph(target, T) for T in random_poses(camera.camera, target, rng, wanted))
    return _write(images, wanted, output / "target", f" of {target.label()}", console)


def _write(images: Iterable[Image], wanted: int, stem: Path, what: str, console: Console) -> dict[str, Any]:
    """Write numbered images; return the object for ``--json``."""
    names = []
    for number, image in enumerate(images, start=1):
        console.progress(f"images{what}", (number - 1) / wanted)
        path = stem.with_name(f"{stem.name}-{number:03d}.png")
        write_png(path, image)
        names.append(str(path))
    console.say(f"{len(names)} images{what} written to {stem.parent}")
    others = {str(p) for p in stem.parent.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES} - set(names)
    if others:
        console.say(
            f"NOTE: {stem.parent} has {len(others)} other images, which stay, and are read with these"
        )
    return {"photographs": names}
