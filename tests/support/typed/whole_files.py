"""TOML files in which every key stands that their readers know, made of the shipped ones."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen
from vision.camera.model import read_camera, write_camera

_MORE_WALLS = """
[[walls]]
name = "ball"
shape = "sphere"
radius_mm = 10
centre_mm = [0, 900, 600]
rpy_deg = [0, 0, 0]

[[walls]]
name = "rail"
shape = "capsule"
radius_mm = 10
length_mm = 100
centre_mm = [0, 900, 800]

[[walls]]
name = "ring"
shape = "torus"
radius_mm = 100
tube_mm = 5
centre_mm = [0, 900, 900]

[[walls]]
name = "bracket"
mesh = "fixtures/meshes/bracket.stl"
mesh_unit = "mm"
origin_mm = [0, 900, 1000]

"""


def whole_cell(scenes: Path) -> Path:
    """The cell file of a copy of the scenes, with every key but `tool.urdf`, which excludes others."""
    cell = scenes / "cell.toml"
    camera = read_camera(scenes / "cameras/lab.toml")
    write_calibration(scenes / "calibration.toml", camera.T_base_camera)
    text = re.sub(r"^# (?!urdf)(\w+ = )", r"\1", cell.read_text(), flags=re.M).replace(
        "# [look.basler]", "[look.basler]"
    )
    text = text.replace(
        "[motion]", "features = { ReverseX = false }\ntimeout_s = 2\nheartbeat_s = 3\n[motion]", 1
    )
    text = text.replace("[look]", _MORE_WALLS + "[look]", 1)
    cell.write_text(text.replace("camera =", 'calibration = "calibration.toml"\ncamera =', 1))
    return cell


def write_calibration(path: Path, T_base_camera: np.ndarray) -> None:
    """One that says everything."""
    links = LinkErrors(*(frozen(np.full(6, 1e-5)) for _ in range(3)))
    write_arm_calibration(
        path,
        ArmCalibration(T_base_camera, frozen(np.full(6, 1e-3)), links, "crs93", "", "", {"by": "a test"}),
    )


def whole_camera(scenes: Path) -> Path:
    """The camera file of a copy of the scenes, with every key."""
    path = scenes / "cameras/lab.toml"
    camera = replace(read_camera(path), lens_covariance=frozen(np.eye(9)))
    write_camera(path, camera, views=[{"image": "01.png"}])
    return path


def whole_world(scenes: Path) -> Path:
    """The world file of a copy of the scenes, with every key."""
    path = scenes / "task2.world.toml"
    path.write_text('camera = "cameras/lab.toml"\n' + path.read_text())
    return path
