"""``a465 calibrate background`` and the looks that follow it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from cell.commands.calibration.background import background_after_hand_eye, background_step
from cell.commands.steps import look_step
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.files.task import read_task
from cell.session.connection import camera_at_start
from typed.command_line import replace_in
from watched.specked import specked_world


def _look(scenes: Path, world: Path) -> dict[str, Any]:
    return look_step(scenes / "task2.toml", None, world, None, None, Console())


def _holes(seen: dict[str, Any]) -> np.ndarray[Any, Any]:
    return np.array([h["T_base_hole"] for b in seen["scenes"][0]["boards"] for h in b["holes"]])[:, :3, 3]


@pytest.mark.slow
def test_a_turned_camera_is_corrected_or_refused(scenes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    world, output = specked_world(scenes), scenes / "background.npz"
    result = background_step(scenes / "task2.toml", output, True, Console(), world=world)
    assert result["features"] > 24
    assert read_cell(scenes / "cell.toml").background_file == output
    before = _look(scenes, world)
    assert before["scenes"][0]["camera"]["moved_mm"] < 0.1
    assert "the camera has moved" not in capsys.readouterr().out
    after = _look(scenes, specked_world(scenes, (0.02, 0.0, 0.0), "turned.toml"))
    camera = after["scenes"][0]["camera"]
    assert camera["moved_mm"] == pytest.approx(0.42, abs=0.06)
    assert "the camera has moved by" in capsys.readouterr().out
    assert np.abs(_holes(after) - _holes(before)).max() < 1e-4
    std = [h["std_mm"] for seen in (before, after) for h in seen["scenes"][0]["boards"][0]["holes"]]
    assert np.mean(std[4:]) > np.mean(std[:4])
    with pytest.raises(ImpossibleError, match=r"the camera moved by 10\.\d+ .*camera_moved_mm"):
        _look(scenes, specked_world(scenes, (0.5, 0.0, 0.0), "knocked.toml"))


def test_what_is_given_is_checked_and_nothing_is_written(scenes: Path) -> None:
    task = scenes / "task2.toml"
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 2")
    with pytest.raises(InputError, match=r"must end in \.npz"):
        background_step(task, scenes / "background.toml", True, Console())
    with pytest.raises(ImpossibleError, match="clear the table"):  # the plain table of the ideal world
        background_step(task, scenes / "background.npz", True, Console())
    assert not (scenes / "background.npz").exists()
    assert "background" not in (scenes / "cell.toml").read_text()


@pytest.mark.slow
def test_a_table_that_shows_too_little_does_not_spoil_a_calibration(
    scenes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task = read_task(scenes / "task2.toml")
    plain = camera_at_start(task, None).grab(2)
    background_after_hand_eye(scenes / "task2.toml", plain, scenes / "b.npz", Console())
    assert "no background was recorded, so a camera that moves is not noticed: " in capsys.readouterr().out
    assert not (scenes / "b.npz").exists()
    specked = camera_at_start(task, specked_world(scenes)).grab(2)
    background_after_hand_eye(scenes / "task2.toml", specked, scenes / "b.npz", Console())
    assert 'now has: background = "b.npz"' in capsys.readouterr().out
    assert read_cell(scenes / "cell.toml").background_file == scenes / "b.npz"
