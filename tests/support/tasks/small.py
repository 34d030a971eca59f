"""The shipped scenes with a camera that costs less: for tests of what a run does, not of how well it sees."""

from __future__ import annotations

import shutil
from pathlib import Path

from arm.io.storage import data_file
from pictures.boards import lab_camera, smaller
from typed.command_line import replace_in
from vision.camera.model import write_camera


def small_scenes(folder: Path) -> Path:
    """A copy in `folder`/scenes with half as many pixels along rows and columns, and two photographs to a look."""
    scenes = Path(shutil.copytree(data_file("scenes"), folder / "scenes"))
    write_camera(scenes / "cameras/lab.toml", smaller(lab_camera(), 0.5))
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 2")
    return scenes
