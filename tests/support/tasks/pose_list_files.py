"""Files with lists of poses, and plans through them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from arm.io.storage import data_file
from arm.plan_file import Plan
from arm.se3 import rot_x, rot_z, transform
from cell.files.pose_list import read_pose_list
from cell.files.reading import Reading
from cell.files.task import read_place
from cell.task.pose_list_planning import place_of_cell, plan_pose_list

CELL = data_file("scenes/cell.toml")
CTU_DEG = ([-30, -20, -90, 0, -60, 10], [0, -10, -90, 0, -70, 0], [30, -15, -95, 0, -65, -20])
TURNED = rot_x(np.pi) @ rot_z(0.6)  # the tool down, its jaws aslant
DOWN = transform(TURNED, (0.42, 0.0, 0.30))
FLANGE = Reading(frame="flange", angles="rad")


def written(folder: Path, content: Any, name: str = "list.json") -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def planned(path: Path, back: bool = False, reading: Reading | None = None, place: Path = CELL) -> Plan:
    return plan_pose_list(place_of_cell(read_place(place), None, 1.0), read_pose_list(path, reading), back)
