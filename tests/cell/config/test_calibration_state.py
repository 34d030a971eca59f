"""A person who lets an arm move is told which calibration and which lens it moves by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen
from cell.config.calibration_state import calibration_lines
from cell.config.cell_file import read_cell
from typed.command_line import replace_in


def test_without_a_calibration_that_is_told_first(scenes: Path) -> None:
    cell = read_cell(scenes / "cell.toml")
    hand_eye, lens = calibration_lines(cell)
    assert calibration_lines(cell, camera=False) == (hand_eye,)
    assert hand_eye == (
        "NOT CALIBRATED: the camera's pose is that of lab.toml (the shipped placeholder), the arm's zeros are nominal"
    )
    assert lens.startswith("lens: PLACEHOLDER, as shipped: ")
    T = np.array(cell.nominal_camera.T_base_camera)
    T[0, 3] += 1e-3
    own = replace(cell, nominal_camera=replace(cell.nominal_camera, T_base_camera=frozen(T)))
    assert "the camera's pose is that of lab.toml, the arm's" in calibration_lines(own)[0]
    K = np.array(cell.nominal_camera.K)
    K[0, 0] += 1.0
    own = replace(cell, nominal_camera=replace(cell.nominal_camera, K=frozen(K)))
    assert "PLACEHOLDER" not in calibration_lines(own)[1]
    assert calibration_lines(own)[1].endswith("without uncertainty")


@pytest.mark.parametrize(
    ("made", "told"),
    [
        ({"held_out_mm": 0.21, "camera_std_mm": 0.05}, "held-out error 0.21 mm, camera position 0.05 mm"),
        ({}, "without uncertainty"),
    ],
)
def test_a_calibration_is_told_by_its_id_and_stated_accuracy(
    scenes: Path, made: dict[str, float], told: str
) -> None:
    camera = read_cell(scenes / "cell.toml").camera
    of = {"unit": "crs93", "lens": camera.lens_digest, "dh": A465.digest}
    found = ArmCalibration(camera.T_base_camera, frozen([0.0] * 6), LinkErrors.none(), **of, made=made)
    write_arm_calibration(scenes / "found.toml", found)
    replace_in(scenes / "cell.toml", "[tool]", 'calibration = "found.toml"\n\n[tool]')
    cell = read_cell(scenes / "cell.toml")
    assert cell.calibration is not None
    hand_eye, _ = calibration_lines(cell)
    assert hand_eye.startswith(f"calibration: {cell.calibration.id}, file of ")
    assert told in hand_eye
