"""``a465 doctor``: check a cell file, its lens and its calibration."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from arm.io.node import Node
from arm.io.rules import path
from arm.io.storage import data_file
from arm.robot.dh import A465
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.finding import NOTE, OK, WRONG, CheckResult
from cell.files.task import read_task
from cell.scene.arm_shape import COMPARE, arm_shape
from vision.camera.model import read_camera

NOMINAL_LENS = "scenes/cameras/lab.toml"
CALIBRATE_LENS = "on a real cell: a465 calibrate camera"
CALIBRATE_ARM = "on a real cell: a465 calibrate hand-eye DATA --collect TASK --port PORT -o FILE --apply"
_DAY_S = 86400.0


@dataclass(frozen=True)
class ReadCell:
    """A cell that was read, with or without its calibration.

    Attributes:
        cell: the cell; without its calibration if that cannot be used.
        title: name of the file, for the table.
        unusable: why the calibration cannot be used; empty if it can, or if there is none.
    """

    cell: Cell
    title: str
    unusable: tuple[InputError, ...]


def read_named(file: Path | None) -> ReadCell:
    """Read a cell or task file; None: the cell of the project's own scenes.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    if file is None:
        return ReadCell(read_cell(data_file("scenes/cell.toml")), "the built-in scene", ())
    unusable: list[InputError] = []
    is_task = "task" in Node.of_toml(file)
    cell = read_task(file, unusable.append).cell if is_task else read_cell(file, unusable.append)
    return ReadCell(cell, str(file), tuple(unusable))


def check_cell(read: ReadCell) -> Sequence[CheckResult]:
    """Check the cell, the arm's shape, the lens and the hand-eye calibration."""
    return (_cell_finding(read), _shape_finding(read.cell), _lens_finding(read.cell), _arm_finding(read))


def _cell_finding(read: ReadCell) -> CheckResult:
    cell = read.cell
    found = (
        f"{read.title} is valid: {cell.unit.name}, {len(cell.boards)} boards, {len(cell.fixed)} fixed bodies, "
        f"digest {cell.digest[:12]}"
    )
    data = {"file": str(cell.file), "unit": cell.unit.name, "digest": cell.digest}
    return CheckResult("cell", OK, found, "", data)


def _shape_finding(cell: Cell) -> CheckResult:
    data = {"padding_mm": 1e3 * cell.arm_padding, "compared": cell.arm_compared}
    verdict, help = (OK, "") if cell.arm_compared.strip() else (NOTE, COMPARE)
    return CheckResult("arm's shape", verdict, arm_shape(cell), help, data)


def _lens_finding(cell: Cell) -> CheckResult:
    calibration = cell.nominal_camera.calibration
    name, (dated, days) = str(calibration.get("id", "without id")), _age(cell.camera_file)
    std = calibration.get("work_std_mm")
    data = {"file": str(cell.camera_file), "id": name, "age_days": days, "work_std_mm": std}
    found = f"{name}, {dated}"
    if cell.nominal_camera.lens_digest == read_camera(data_file(NOMINAL_LENS)).lens_digest:
        note = "the nominal lens of a lab, not calibrated"
    elif cell.nominal_camera.lens_covariance is None or std is None:
        note = "without uncertainty"
    else:
        found = f"{found}: {std:g} mm at the work points (one standard deviation)"
        return CheckResult("lens", OK, found, "", data)
    return CheckResult("lens", NOTE, f"{found}: {note}", CALIBRATE_LENS, data)


def _arm_finding(read: ReadCell) -> CheckResult:
    cell = read.cell
    if read.unusable:
        return CheckResult("hand-eye", WRONG, str(read.unusable[0]), CALIBRATE_ARM, read.unusable[0].data)
    calibration = cell.calibration
    if calibration is None:
        found = f"none: the camera's pose is that of {cell.camera_file.name}, the arm's zeros are nominal"
        return CheckResult("hand-eye", NOTE, found, CALIBRATE_ARM, {"id": None})
    dated, days = _age(Node.of_toml(cell.file).get("calibration", path()))
    made = calibration.made
    data = {"id": calibration.id, "age_days": days, "unit": calibration.unit, "made": dict(made)}
    found = f"{calibration.id}, {dated}, of {calibration.unit}"
    unnamed = [
        what
        for what, digest in (("lens", calibration.lens), ("arm", calibration.dh))
        if digest not in (cell.camera.lens_digest, A465.digest)
    ]
    if unnamed or "held_out_mm" not in made:
        note = f"does not name its {' and '.join(unnamed)}" if unnamed else "without uncertainty"
        return CheckResult("hand-eye", NOTE, f"{found}: {note}", CALIBRATE_ARM, data)
    accuracy = f"held-out error {made['held_out_mm']:g} mm"
    if "camera_std_mm" in made:
        accuracy += f", camera position {made['camera_std_mm']:g} mm (one standard deviation)"
    return CheckResult("hand-eye", OK, f"{found} and this lens: {accuracy}", "", data)


def _age(file: Path) -> tuple[str, int]:
    """Describe the date of a file; return the text and its age in days."""
    written = file.stat().st_mtime
    days = max(int((time.time() - written) / _DAY_S), 0)
    ago = "today" if days == 0 else f"{days} day{'' if days == 1 else 's'} old"
    return f"file of {time.strftime('%Y-%m-%d', time.localtime(written))} ({ago})", days
