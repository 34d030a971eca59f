"""A look that says what is true: boards where the world file has them, cubes in the holes that it fills."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arm.io.storage import data_file
from arm.poses import BoardPose
from cell.files.task import Task
from cell.files.world import read_world
from vision.observation import Observation, ObservedBoard
from vision.occupancy.classify import Occupancy


def true_look(task: Task, world_file: Path | None = None) -> Observation:
    """What a look at a world of a task, the shipped one by default, would give if the camera were perfect."""
    file = world_file or data_file(f"scenes/{task.name}.world.toml")
    world = read_world(file, task.cell.boards[0].marker_size)
    boards = []
    for b in world.boards:
        pose = BoardPose(b.board, b.T_base_board, 1e-8 * np.eye(6), 0.1, 100.0)
        holes = (Occupancy("cube" if hole in b.cubes else "empty") for hole in range(4))
        boards.append(ObservedBoard(pose, tuple(holes)))
    return Observation(tuple(boards))
