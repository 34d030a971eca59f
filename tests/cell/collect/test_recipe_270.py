"""The recipe of 270 poses."""

from __future__ import annotations

import numpy as np
import pytest

import cell.collect.pose_pool
import cell.collect.recipe_270
import cell.commands.calibration.collect
import cell.session.connection
from arm.errors import ImpossibleError
from arm.io.storage import data_file
from arm.se3 import Array
from cell.collect.collector import seen_corners
from cell.collect.pose_pool import HandView
from cell.collect.recipe_270 import RISE, WRIST_STEP, recipe_poses
from cell.config.cell_file import read_cell
from cell.files.world import read_world
from cell.sim.cell import SimulatedCamera, SimulatedCell
from vision.targets.target import TargetFinder

HAND = data_file("scenes/targets/hand.toml")


def photographed(view: HandView, q: Array) -> Array:
    """Corners (m, 2) px that a rendered photograph shows, the arm in it."""
    cell = read_cell(data_file("scenes/cell.toml"))
    world = read_world(data_file("scenes/task2.world.toml"), cell.boards[0].marker_size)
    simulated = SimulatedCell(cell, world)
    simulated.in_hand = view.hand
    counts = cell.unit.counts(q)
    camera = SimulatedCamera(simulated, cell.camera, lambda: counts, cell.dictionary)
    return seen_corners(camera, TargetFinder(view.hand.target), 1)


def require_shown_whole(view: HandView, q: Array) -> None:
    corners = photographed(view, q)
    assert np.isfinite(corners).all()
    T = view.robot.T_base_tool(q) @ np.linalg.inv(view.robot.T_end_tool) @ view.hand.T_flange_target
    at = view.hand.target.points() @ T[:3, :3].T + T[:3, 3]
    assert np.abs(corners - view.camera.project_base(at)).max() < 0.5


@pytest.mark.slow
def test_the_recipe_is_rows_of_turning_wrists_at_heights_0_1_m_apart(
    shown: HandView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.collect.recipe_270, "DISTANCES", (0.71, 0.9))
    poses = recipe_poses(shown, 200, 0)
    assert poses.shape == (200, 6)
    assert len(np.unique(poses, axis=0)) == 200
    assert all(shown.shows(q) for q in poses)
    for q in poses[[0, 150]]:
        require_shown_whole(shown, q)
    heights = np.array([shown.T_base_target(q)[2, 3] for q in poses])
    means = [float(np.median(heights[part])) for part in (slice(100), slice(100, 200))]
    assert means[1] - means[0] == pytest.approx(RISE, abs=0.04)
    steps = np.diff(poses[:100], axis=0)
    wrist = steps[:, 3:] / WRIST_STEP
    together = np.ptp(wrist, axis=1) < 1e-6  # the others lean
    assert together.mean() > 0.5
    assert (np.abs(wrist[together, 0] - wrist[together, 0].round()) < 1e-6).all()
    rows = steps[together, 0] / np.radians(1.5)
    assert (np.abs(rows - rows.round()) < 1e-6).all()


def test_poses_that_the_recipe_does_not_have_are_told(
    shown: HandView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.collect.recipe_270, "DISTANCES", (0.85, 0.9))
    with pytest.raises(ImpossibleError, match="omit --recipe") as told:
        recipe_poses(shown, 270, 0)
    assert (told.value.data["found"], told.value.data["wanted"]) == (100, 270)
