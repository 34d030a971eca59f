"""``a465 doctor``: a cell file, the lens and the calibration that it rests on."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import data_file
from arm.io.toml_reader import TomlTable
from arm.robot.dh import A465
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.finding import NOTE, OK, WRONG, Finding
from cell.files.task import read_task
from cell.scene.arm_shape import COMPARE, arm_shape
from vision.camera.model import read_camera

NOMINAL_LENS = "scenes/cameras/lab.toml"
CALIBRATE_LENS = "on a real cell: a465 calibrate camera"
CALIBRATE_ARM = "on a real cell: a465 calibrate hand-eye DATA --collect TASK --port PORT -o FILE --apply"
_DAY_S = 86400.0


@dataclass(frozen=True)
class ReadCell:
    """A cell as it was read.

    Attributes:
        cell: without its calibration, if that cannot be used.
        title: what was read.
        unusable: why its calibration cannot be used; none if it can, or there is none.
    """

    cell: Cell
    title: str
    unusable: tuple[InputError, ...]


def read_named(file: Path | None) -> ReadCell:
    """A cell or task file; None: the cell of the project's own scenes.

    Raises:
        InputError: with file, key, value and rule.
    """
    if file is None:
        return ReadCell(read_cell(data_file("scenes/cell.toml")), "the built-in scene", ())
    unusable: list[InputError] = []
    is_task = "task" in TomlTable.read(file)
    cell = read_task(file, unusable.append).cell if is_task else read_cell(file, unusable.append)
    return ReadCell(cell, str(file), tuple(unusable))


def cell_findings(read: ReadCell) -> Sequence[Finding]:
    """The cell, its lens, and what a calibration says of its arm and camera."""
    return (_cell_finding(read), _shape_finding(read.cell), _lens_finding(read.cell), _arm_finding(read))


def _cell_finding(read: ReadCell) -> Finding:
    cell = read.cell
    found = (
        f"{read.title} reads: {cell.unit.name}, {len(cell.boards)} boards, {len(cell.fixed)} fixed bodies, "
        f"digest {cell.digest[:12]}"
    )
    data = {"file": str(cell.file), "unit": cell.unit.name, "digest": cell.digest}
    return Finding("cell", OK, found, "", data)


def _shape_finding(cell: Cell) -> Finding:
    data = {"padding_mm": 1e3 * cell.arm_padding, "compared": cell.arm_compared}
    compared = bool(cell.arm_compared.strip())
    return Finding(
        "arm's shape", OK if compared else NOTE, arm_shape(cell), "" if compared else COMPARE, data
    )


def _lens_finding(cell: Cell) -> Finding:
    calibration = cell.nominal_camera.calibration
    name, (dated, days) = str(calibration.get("id", "without id")), _age(cell.camera_file)
    std = calibration.get("work_std_mm")
    data = {"file": str(cell.camera_file), "id": name, "age_days": days, "work_std_mm": std}
    found = f"{name}, {dated}"
    if cell.nominal_camera.lens_digest == read_camera(data_file(NOMINAL_LENS)).lens_digest:
        return Finding(
            "lens", NOTE, f"{found}: the nominal lens of a lab, no calibration", CALIBRATE_LENS, data
        )
    if cell.nominal_camera.lens_covariance is None or std is None:
        return Finding("lens", NOTE, f"{found}: does not say how certain it is", CALIBRATE_LENS, data)
    return Finding("lens", OK, f"{found}: {std:g} mm at the work (one standard deviation)", "", data)


def _arm_finding(read: ReadCell) -> Finding:
    cell = read.cell
    if read.unusable:
        return Finding("hand-eye", WRONG, str(read.unusable[0]), CALIBRATE_ARM, read.unusable[0].data)
    calibration = cell.calibration
    if calibration is None:
        found = f"none: the camera stands where {cell.camera_file.name} says, the arm's zeros are nominal"
        return Finding("hand-eye", NOTE, found, CALIBRATE_ARM, {"id": None})
    dated, days = _age(TomlTable.read(cell.file).path("calibration"))
    made = calibration.made
    data = {"id": calibration.id, "age_days": days, "unit": calibration.unit, "made": dict(made)}
    found = f"{calibration.id}, {dated}, of {calibration.unit}"
    unsaid = [
        what
        for what, digest in (("lens", calibration.lens), ("arm", calibration.dh))
        if digest not in (cell.camera.lens_digest, A465.digest)
    ]
    if unsaid:
        return Finding(
            "hand-eye", NOTE, f"{found}: does not say of which {' and '.join(unsaid)}", CALIBRATE_ARM, data
        )
    if "held_out_mm" not in made:
        return Finding("hand-eye", NOTE, f"{found}: does not say how certain it is", CALIBRATE_ARM, data)
    certain = f"held-out targets {made['held_out_mm']:g} mm off"
    if "camera_std_mm" in made:
        certain += f", camera's place {made['camera_std_mm']:g} mm (one standard deviation)"
    return Finding("hand-eye", OK, f"{found} and this lens: {certain}", "", data)


def _age(file: Path) -> tuple[str, int]:
    """When a file was last written, in words, and how many days ago."""
    written = file.stat().st_mtime
    days = max(int((time.time() - written) / _DAY_S), 0)
    ago = "today" if days == 0 else f"{days} day{'' if days == 1 else 's'} old"
    return f"file of {time.strftime('%Y-%m-%d', time.localtime(written))} ({ago})", days
