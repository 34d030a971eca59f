"""Trajectories of other programs in the shipped cell."""

from __future__ import annotations

from typing import Any

import numpy as np

from arm.io.storage import data_file
from arm.se3 import frozen
from cell.files.task import read_place
from cell.foreign.trajectory_file import JointTrajectory
from cell.scene.build import build_scene
from plan.collision.world import World
from vision.observation import Observation

CELL = data_file("scenes/cell.toml")
START = np.radians([-60.0, -40.0, -80.0, 0.0, -60.0, 0.0])
OVER = np.radians([0.0, -10.0, -90.0, 0.0, -70.0, 0.0])


def trajectory(points: Any, times: Any, cubics: bool = True) -> JointTrajectory:
    """A trajectory through configurations, at rest at both ends."""
    q, t = np.asarray(points, dtype=float), np.asarray(times, dtype=float)
    rate = np.gradient(q, t, axis=0)
    rate[[0, -1]] = 0.0
    return JointTrajectory(frozen(t), frozen(q), frozen(rate) if cubics else None)


def world() -> World:
    scene = build_scene(read_place(CELL).cell, Observation())
    return World(scene.robot_open, scene.bodies)
