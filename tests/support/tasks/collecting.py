"""A collection of poses, fast, and what it says."""

from __future__ import annotations

import numpy as np

from arm.io.storage import data_file
from arm.se3 import Array
from cell.collect.collector import seen_corners
from cell.collect.pose_pool import HandView
from cell.collect.record import HandRecord
from cell.config.cell_file import read_cell
from cell.files.world import read_world
from cell.session.connection import WhichCell
from cell.sim.camera import SimulatedCamera
from cell.sim.cell import SimulatedCell
from vision.targets.target import TargetFinder

FAST = WhichCell(speed=1.0, time_scale=100.0)


def taken(record: HandRecord, number: int) -> tuple[tuple[int, ...], Array]:
    corners = len(record.hand.target.points())
    return (100 * number,) * 6, np.random.default_rng(number).uniform(10.0, 900.0, (corners, 2))


def photographed(view: HandView, q: Array) -> Array:
    """Corners (m, 2) px that a rendered photograph shows, the arm in it."""
    cell = read_cell(data_file("scenes/cell.toml"))
    world = read_world(data_file("scenes/task2.world.toml"), cell.boards[0].marker_size)
    simulated = SimulatedCell(cell, world)
    simulated.in_hand = view.hand
    counts = cell.unit.counts(q)
    camera = SimulatedCamera(simulated, cell.camera, lambda: counts, cell.dictionary)
    return seen_corners(camera.grab(1), TargetFinder(view.hand.target))


def require_shown_whole(view: HandView, q: Array) -> None:
    """The rendered image shows the target whole, where the camera model has it."""
    corners = photographed(view, q)
    assert np.isfinite(corners).all()
    T = view.robot.T_base_tool(q) @ np.linalg.inv(view.robot.T_end_tool) @ view.hand.T_flange_target
    at = view.hand.target.points() @ T[:3, :3].T + T[:3, 3]
    assert np.abs(corners - view.camera.project_base(at)).max() < 0.5
