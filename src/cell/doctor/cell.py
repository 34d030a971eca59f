"""``a465 doctor``: check a cell file, its lens and its calibration."""

from __future__ import annotations

from pathlib import Path

from arm.errors import InputError
from arm.io.storage import data_file
from cell.config.calibration_state import CalibrationState, hand_eye_state, lens_state
from cell.config.cell import Cell
from cell.config.doubts.cell_doubts import cell_doubts
from cell.doctor.finding import NOTE, OK, WRONG, CheckResult
from cell.files.task import cell_of
from cell.session.camera_watch import camera_watch

CALIBRATE_LENS = "on a real cell: a465 calibrate camera"
CALIBRATE_ARM = "on a real cell: a465 calibrate hand-eye DATA --collect TASK --port PORT -o FILE --apply"
COMPARE = "docs/real-cell.md, step 2, explains how to compare these bodies with your arm"
WATCH = "a465 calibrate background TASK -o background.npz --apply"


def check_cell(file: Path | None) -> tuple[tuple[CheckResult, ...], Cell]:
    """Read a cell or task file; check cell, arm's shape, lens, hand-eye calibration and the watch on the camera.

    Args:
        file: None: the cell of the project's own scenes.

    Returns:
        The results, and the cell; without its calibration if that cannot be used.

    Raises:
        InputError: a value is wrong; names file, key, value and rule.
    """
    unusable: list[InputError] = []
    cell = cell_of(file or data_file("scenes/cell.toml"), unusable.append)
    found = (
        f"{file or 'the built-in scene'} is valid: {cell.unit.name}, {len(cell.boards)} boards, "
        f"{len(cell.fixed)} fixed bodies, digest {cell.digest[:12]}"
    )
    data = {"file": str(cell.file), "unit": cell.unit.name, "digest": cell.digest}
    arm = _finding("hand-eye", hand_eye_state(cell), CALIBRATE_ARM)
    if unusable:
        arm = CheckResult("hand-eye", WRONG, str(unusable[0]), CALIBRATE_ARM, unusable[0].data)
    about_shape = {"padding_mm": 1e3 * cell.arm_padding, "compared": cell.arm_compared}
    verdict, help = (OK, "") if cell.arm_compared.strip() else (NOTE, COMPARE)
    shape = CheckResult("arm's shape", verdict, cell.arm_shape(), help, about_shape)
    doubt = "; ".join(cell_doubts(cell))
    results = (
        CheckResult("cell", NOTE if doubt else OK, found, doubt, data),
        shape,
        _finding("lens", lens_state(cell), CALIBRATE_LENS),
        arm,
        _watch_finding(cell),
    )
    return results, cell


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
