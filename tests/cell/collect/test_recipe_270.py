"""The recipe of 270 poses."""

from __future__ import annotations

import numpy as np
import pytest

import cell.collect.pose_pool
import cell.collect.recipe_270
import cell.commands.calibration.collect
import cell.session.connection
from arm.errors import ImpossibleError
from cell.collect.pose_pool import HandView
from cell.collect.recipe_270 import RISE, WRIST_STEP, recipe_poses
from tasks.collecting import require_shown_whole


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


@pytest.mark.slow
def test_poses_that_the_recipe_does_not_have_are_told(
    shown: HandView, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cell.collect.recipe_270, "DISTANCES", (0.85, 0.9))
    with pytest.raises(ImpossibleError, match="omit --recipe") as told:
        recipe_poses(shown, 270, 0)
    assert (told.value.data["found"], told.value.data["wanted"]) == (100, 270)
