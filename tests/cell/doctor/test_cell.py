"""Lens and hand-eye calibration as `a465 doctor` finds them."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from arm.calibration_file import ArmCalibration, write_arm_calibration
from arm.robot.dh import A465
from arm.robot.link_errors import LinkErrors
from arm.se3 import frozen
from cell.config.cell_file import read_cell
from cell.doctor import cell as doctorcell
from cell.doctor.finding import NOTE, OK, WRONG, CheckResult
from typed.command_line import replace_in
from vision.camera.model import read_camera, write_camera

pytestmark = pytest.mark.xdist_group("doctor")


def look_at(file: Path) -> dict[str, CheckResult]:
    return {f.check: f for f in doctorcell.check_cell(file)[0]}


def calibrated(scenes: Path, **others: Any) -> Path:
    """A cell file that names a calibration of ten days ago."""
    camera = read_cell(scenes / "cell.toml").camera
    of = {"unit": "crs93", "lens": camera.lens_digest, "dh": A465.digest} | others
    made = of.pop("made", {"held_out_mm": 0.21, "camera_std_mm": 0.05})
    found = ArmCalibration(camera.T_base_camera, frozen([0.0] * 6), LinkErrors.none(), **of, made=made)
    write_arm_calibration(scenes / "found.toml", found)
    then = time.time() - 10.5 * 86400.0
    os.utime(scenes / "found.toml", (then, then))
    replace_in(scenes / "cell.toml", "[tool]", 'calibration = "found.toml"\n\n[tool]')
    return scenes / "cell.toml"


def test_an_uncalibrated_cell_is_a_note(scenes: Path) -> None:
    found = look_at(scenes / "cell.toml")
    assert [found[name].verdict for name in ("cell", "lens", "hand-eye")] == [OK, NOTE, NOTE]
    assert "the nominal lens of a lab" in found["lens"].found
    assert "a465 calibrate camera" in found["lens"].help
    assert found["hand-eye"].found.startswith("none: the camera's pose is that of lab.toml")
    assert "a465 calibrate hand-eye" in found["hand-eye"].help


def test_a_camera_that_is_not_watched_is_a_note_and_a_wrong_background_an_error(scenes: Path) -> None:
    found = look_at(scenes / "cell.toml")["camera's watch"]
    assert found.verdict == NOTE
    assert "a465 calibrate background" in found.help
    replace_in(scenes / "cell.toml", "[tool]", 'background = "none.npz"\n\n[tool]')
    assert look_at(scenes / "cell.toml")["camera's watch"].verdict == WRONG


def test_a_calibration_is_told_with_its_age_and_how_certain_it_is(scenes: Path) -> None:
    file = calibrated(scenes)
    found = look_at(file)["hand-eye"]
    calibration = read_cell(file).calibration
    assert calibration is not None
    assert found.verdict == OK
    assert found.data["id"] == calibration.id
    assert found.data["age_days"] == 10
    assert calibration.id in found.found
    assert "(10 days old), of crs93 and this lens: held-out error 0.21 mm" in found.found
    assert "camera position 0.05 mm (one standard deviation)" in found.found


@pytest.mark.parametrize(
    ("others", "verdict", "told"),
    [
        ({"unit": "crs97"}, WRONG, "is of crs97, but unit is crs93"),
        ({"lens": "f" * 64}, WRONG, "with another lens than that of the camera file"),
        ({"dh": "f" * 64}, WRONG, "other dimensions"),
        ({"lens": ""}, NOTE, "does not name its lens"),
        ({"lens": "", "dh": ""}, NOTE, "does not name its lens and arm"),
        ({"made": {"poses": 8}}, NOTE, "without uncertainty"),
    ],
)
def test_a_calibration_that_is_not_of_this_cell(
    scenes: Path, others: dict[str, Any], verdict: str, told: str
) -> None:
    file = calibrated(scenes, **others)
    for named in (file, scenes / "task2.toml"):
        found = look_at(named)
        assert found["cell"].verdict == OK
        assert found["hand-eye"].verdict == verdict
        assert told in found["hand-eye"].found
        assert "a465 calibrate hand-eye" in found["hand-eye"].help


def test_a_lens_of_ones_own_is_told_with_its_uncertainty(scenes: Path) -> None:
    file = scenes / "cameras/lab.toml"
    camera = read_camera(file)
    K = camera.K.copy()
    K[0, 0] += 1.0
    own = type(camera)(
        K, camera.distortion, camera.size, camera.T_base_camera, {"id": "lens-1", "work_std_mm": 0.07}
    )
    write_camera(file, own)
    found = look_at(scenes / "cell.toml")["lens"]
    assert (found.verdict, found.data["id"]) == (NOTE, "lens-1")
    assert "without uncertainty" in found.found
    known = type(camera)(K, own.distortion, own.size, own.T_base_camera, own.calibration, np.eye(9))
    write_camera(file, known)
    found = look_at(scenes / "cell.toml")["lens"]
    assert found.verdict == OK
    assert found.found.endswith("(today): 0.07 mm at the work points (one standard deviation)")
