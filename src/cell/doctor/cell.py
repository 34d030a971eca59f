"""``a465 doctor``: check a cell file, its lens and its calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import data_file
from cell.config.calibration_state import CalibrationState, hand_eye_state, lens_state
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.finding import NOTE, OK, WRONG, CheckResult
from cell.files.task import cell_of
from cell.session.camera_watch import camera_watch

CALIBRATE_LENS = "on a real cell: a465 calibrate camera"
CALIBRATE_ARM = "on a real cell: a465 calibrate hand-eye DATA --collect TASK --port PORT -o FILE --apply"
COMPARE = "docs/real-cell.md, step 2, explains how to compare these bodies with your arm"
WATCH = "a465 calibrate background TASK -o background.npz --apply"


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
    return ReadCell(cell_of(file, unusable.append), str(file), tuple(unusable))


def check_cell(read: ReadCell) -> Sequence[CheckResult]:
    """Check the cell, the arm's shape, the lens, the hand-eye calibration and the watch on the camera."""
    lens = _finding("lens", lens_state(read.cell), CALIBRATE_LENS)
    return _cell_finding(read), _shape_finding(read.cell), lens, _arm_finding(read), _watch_finding(read.cell)


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
    return CheckResult("arm's shape", verdict, cell.arm_shape(), help, data)


def _arm_finding(read: ReadCell) -> CheckResult:
    if read.unusable:
        return CheckResult("hand-eye", WRONG, str(read.unusable[0]), CALIBRATE_ARM, read.unusable[0].data)
    return _finding("hand-eye", hand_eye_state(read.cell), CALIBRATE_ARM)


def _watch_finding(cell: Cell) -> CheckResult:
    """Check the background that looks compare the camera with."""
    name = "camera's watch"
    try:
        watch = camera_watch(cell)
    except InputError as error:
        return CheckResult(name, WRONG, str(error), WATCH, error.data)
    if watch is None:
        return CheckResult(name, NOTE, "off: a camera that moves is not noticed", WATCH, {"background": None})
    count = len(watch.background.points)
    found = f"{count} features of the background; up to {1e3 * watch.limit:g} mm at the table is corrected"
    return CheckResult(name, OK, found, "", {"background": str(cell.background_file), "features": count})


def _finding(check: str, state: CalibrationState, help: str) -> CheckResult:
    verdict, help = (NOTE, help) if state.doubt else (OK, "")
    return CheckResult(check, verdict, str(state), help, state.data)
