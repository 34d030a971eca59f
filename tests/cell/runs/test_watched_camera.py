"""A run whose camera was knocked since its background was recorded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from cell.commands.calibration.background import background_step
from cell.console import Console
from tasks.whole_run import run_whole
from watched.specked import specked_world


@pytest.mark.slow
def test_a_knocked_camera_is_refused_before_anything_moves(scenes: Path, tmp_path: Path) -> None:
    task = scenes / "task2.toml"
    background_step(task, scenes / "background.npz", True, Console(), world=specked_world(scenes))
    knocked = specked_world(scenes, (0.0, 0.5, 0.0), "knocked.toml")
    run = run_whole(task, tmp_path / "run", world=knocked)
    assert isinstance(run.error, ImpossibleError)
    assert "the camera moved by 10." in str(run.error)
    assert run.record is not None
    assert len(run.history) == 1  # the jaws did not move
    assert len(np.unique(run.record.counts, axis=0)) <= 1
