"""Which lens and which hand-eye calibration a cell uses, and how accurate they are stated to be."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from arm.io.node import Node
from arm.io.rules import path
from arm.io.storage import data_file
from arm.numerics.products import norm
from arm.robot.dh import A465
from cell.config.cell import Cell
from vision.camera.model import Camera, read_camera

PLACEHOLDER_LENS = "the nominal lens of a lab, not calibrated"
_DAY_S = 86400.0


@dataclass(frozen=True)
class CalibrationState:
    """A lens or a hand-eye calibration.

    Attributes:
        found: its id, date and stated accuracy, or "none".
        doubt: why its accuracy is unknown, or what is used in its place; empty if the accuracy is known.
        data: id, age and accuracy as JSON types; an id of None: there is no calibration.
    """

    found: str
    doubt: str
    data: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.found}: {self.doubt}" if self.doubt else self.found


def lens_state(cell: Cell) -> CalibrationState:
    """Describe the lens of the camera file."""
    calibration = cell.nominal_camera.calibration
    name, (dated, days) = str(calibration.get("id", "without id")), _age(cell.camera_file)
    std = calibration.get("work_std_mm")
    data = {"file": str(cell.camera_file), "id": name, "age_days": days, "work_std_mm": std}
    found = f"{name}, {dated}"
    if cell.nominal_camera.lens_digest == _placeholder().lens_digest:
        return CalibrationState(found, PLACEHOLDER_LENS, data)
    if cell.nominal_camera.lens_covariance is None or std is None:
        return CalibrationState(found, "without uncertainty", data)
    return CalibrationState(f"{found}: {std:g} mm at the work points (one standard deviation)", "", data)


def hand_eye_state(cell: Cell) -> CalibrationState:
    """Describe the calibration of the camera's pose and the arm's zeros, or what is used without one."""
    calibration = cell.calibration
    if calibration is None:
        shipped = norm(cell.nominal_camera.T_base_camera - _placeholder().T_base_camera) < 1e-9
        camera = f"{cell.camera_file.name}{' (the shipped placeholder)' if shipped else ''}"
        doubt = f"the camera's pose is that of {camera}, the arm's zeros are nominal"
        return CalibrationState("none", doubt, {"id": None})
    dated, days = _age(Node.of_toml(cell.file).get("calibration", path()))
    made = calibration.made
    data = {"id": calibration.id, "age_days": days, "unit": calibration.unit, "made": dict(made)}
    found = f"{calibration.id}, {dated}, of {calibration.unit}"
    unnamed = [
        what
        for what, digest in (("lens", calibration.lens), ("arm", calibration.dh))
        if digest not in (cell.nominal_camera.lens_digest, A465.digest)
    ]
    if unnamed or "held_out_mm" not in made:
        doubt = f"does not name its {' and '.join(unnamed)}" if unnamed else "without uncertainty"
        return CalibrationState(found, doubt, data)
    accuracy = f"held-out error {made['held_out_mm']:g} mm"
    if "camera_std_mm" in made:
        accuracy += f", camera position {made['camera_std_mm']:g} mm (one standard deviation)"
    return CalibrationState(f"{found} and this lens: {accuracy}", "", data)


def calibration_lines(cell: Cell, camera: bool = True) -> tuple[str, ...]:
    """Say which calibration a cell uses, and with a camera which lens, to a person who lets an arm move by them."""
    hand_eye, lens = hand_eye_state(cell), lens_state(cell)
    arm = f"NOT CALIBRATED: {hand_eye.doubt}" if hand_eye.data["id"] is None else f"calibration: {hand_eye}"
    placeholder = "PLACEHOLDER, as shipped: " if lens.doubt == PLACEHOLDER_LENS else ""
    return (arm, f"lens: {placeholder}{lens}") if camera else (arm,)


def _placeholder() -> Camera:
    return read_camera(data_file("scenes/cameras/lab.toml"))


def _age(file: Path) -> tuple[str, int]:
    """Describe the date of a file; return the text and its age in days."""
    written = file.stat().st_mtime
    days = max(int((time.time() - written) / _DAY_S), 0)
    ago = "today" if days == 0 else f"{days} day{'' if days == 1 else 's'} old"
    return f"file of {time.strftime('%Y-%m-%d', time.localtime(written))} ({ago})", days
