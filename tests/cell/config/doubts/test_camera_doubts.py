"""A camera that is rather meant in another unit or place is told, and not refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.se3 import Array, frozen
from cell.config.camera_keys import CellCamera
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.config.doubts.camera_doubts import camera_doubts
from cell.config.doubts.cell_doubts import cell_doubts
from vision.camera.basler import BaslerSettings
from vision.camera.video.settings import VideoSettings


@pytest.fixture
def cell(scenes: Path) -> Cell:
    return read_cell(scenes / "cell.toml")


@pytest.mark.parametrize(
    ("live", "told"),
    [
        (
            CellCamera(basler=BaslerSettings(exposure=8e-6)),
            "look.basler.exposure_us = 8: is it in ms? .* 8000 in us",
        ),
        (CellCamera(video=VideoSettings(latency=50.0)), "look.video.latency_s = 50: is it in ms?"),
        (CellCamera(video=VideoSettings(latency=0.0)), "look.video.latency_s = 0: was it measured?"),
    ],
)
def test_settings_in_another_unit(cell: Cell, live: CellCamera, told: str) -> None:
    (doubt,) = camera_doubts(replace(cell, live_camera=live))
    for part in told.split(" .* "):
        assert part in doubt


def test_settings_that_cameras_have(cell: Cell) -> None:
    live = CellCamera(basler=BaslerSettings(exposure=2e-4), video=VideoSettings(latency=2.5))
    assert tuple(camera_doubts(replace(cell, live_camera=live))) == ()


@pytest.mark.parametrize(
    ("scale", "skew", "told"),
    [(1.1, 0.0, "pixels that are not square"), (1.0, 12.0, "the skew, is 12 px"), (1.01, 0.5, "")],
)
def test_a_matrix_with_a_wrong_number(cell: Cell, scale: float, skew: float, told: str) -> None:
    K = cell.nominal_camera.K.copy()
    K[0, 0] *= scale
    K[0, 1] = skew
    doubts = "; ".join(camera_doubts(replace(cell, nominal_camera=replace(cell.nominal_camera, K=frozen(K)))))
    assert told in doubts
    assert bool(told) == bool(doubts)


def _placed(cell: Cell, T: Array) -> Cell:
    return replace(cell, camera=cell.camera.at(frozen(T)))


def test_a_place_from_which_no_board_is_seen(cell: Cell) -> None:
    T = cell.camera.T_base_camera
    in_cm, aside = T.copy(), T.copy()
    in_cm[:3, 3] /= 10.0
    aside[:2, 3] = T[1, 3], T[0, 3]
    (low,) = cell_doubts(_placed(cell, in_cm))
    assert low == (
        "cell.toml: lab.toml: the camera is at 49, -1, 119 mm, lower than the zone for boards, which ends at z = 218 "
        "mm: is its position in another unit?"
    )
    for pose in (aside, np.asarray(cell.camera.T_camera_base)):
        (doubt,) = camera_doubts(_placed(cell, pose))
        assert (
            "does not have the middle of the zone for boards (boards.zone_centre_mm) in its image of 1920"
            in doubt
        )
    assert tuple(camera_doubts(cell)) == ()
