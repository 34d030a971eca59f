"""The shipped scenes with a camera that costs less: for tests of what a run does, not of how well it sees."""

from __future__ import annotations

import shutil
from pathlib import Path

from arm.io.storage import data_file
from pictures.boards import lab_camera, smaller
from typed.command_line import replace_in
from vision.camera.model import write_camera


def small_scenes(folder: Path) -> Path:
    """A copy in `folder`/scenes with half as many pixels along rows and columns, and two photographs to a look.

    The realistic cells keep the camera that their shipped calibration is for.
    """
    scenes = Path(shutil.copytree(data_file("scenes"), folder / "scenes"))
    shutil.copy(scenes / "cameras/lab.toml", scenes / "cameras/whole.toml")
    for world in scenes.rglob("realistic/*.world.toml"):
        replace_in(world, "cameras/lab.toml", "cameras/whole.toml")
    write_camera(scenes / "cameras/lab.toml", smaller(lab_camera(), 0.5))
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 2")
    return scenes


def leave_cubes(scenes: Path, *holes: int) -> None:
    """Leave cubes in these holes alone of the board that holds them, in all worlds of a folder."""
    for world in scenes.rglob("task*.world.toml"):
        replace_in(world, "cubes = [1, 2, 3, 4]", f"cubes = {list(holes)}")


def quick_scenes(folder: Path, *holes: int) -> Path:
    """Small scenes with fewer cubes and twice the speed: what a run decides after a cube does not depend on them."""
    scenes = small_scenes(folder)
    leave_cubes(scenes, *holes)
    replace_in(scenes / "cell.toml", "speed = 0.5", "speed = 1.0")
    return scenes
