"""``a465 doctor``: check the installation, the devices and a cell. This module imports nothing that may be missing.

Every check has a deadline and ends as a row of the table, whatever happens in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cell.console import WIDTH, Console
from cell.doctor.finding import OK, VERDICTS, WRONG, CheckResult, guarded

if TYPE_CHECKING:
    from cell.config.cell import Cell

_HEADER = ("check", "verdict", "found, and what would help")
ROWS = 14  # approximate, for the progress bar
_INSTALL_S, _PORTS_S, _CELL_S = 20.0, 10.0, 60.0
_CONTROLLER_S = 40.0  # three STAMP commands, VER, and the look-up of a host name
_CAMERAS_S, _PHOTOGRAPH_S = 30.0, 100.0  # network cameras are found by broadcast
_SELF_TEST_S = 60.0  # takes five seconds; more on a slow disk

Rows = Callable[[], "CheckResult | Iterable[CheckResult]"]


def doctor_step(
    port: str | None, camera: str | None, cell_file: Path | None, console: Console
) -> dict[str, Any]:
    """Run all checks and print a table; return the worst verdict and all rows as JSON types.

    Args:
        port: port of a controller to identify; None: no port is opened.
        camera: selector of a camera to take an image with; None: no camera is opened.
        cell_file: cell or task file; None: the built-in scene.
        console: output.
    """
    findings: list[CheckResult] = []
    for finding in _findings(port, camera, cell_file):
        findings.append(finding)
        console.progress(finding.check, len(findings) / ROWS)
    console.table(_HEADER, [_table_row(finding) for finding in findings], WIDTH)
    verdict = max((f.verdict for f in findings), key=VERDICTS.index)
    counted = ", ".join(f"{sum(f.verdict == v for f in findings)} {v}" for v in VERDICTS)
    console.say(counted)
    return {
        "verdict": verdict,
        "wrong": [f.check for f in findings if f.verdict == WRONG],
        "checks": [f.to_json() for f in findings],
    }


def _findings(port: str | None, camera: str | None, cell_file: Path | None) -> Iterator[CheckResult]:
    """Run the checks one after the other; each imports what it needs."""
    from cell.doctor import installation as install

    yield from _row("Python", install.check_python, _INSTALL_S)
    yield from _row("libraries", install.check_libraries, _INSTALL_S)
    yield from _row("extras", install.check_extras, _INSTALL_S)
    yield from _devices(port)
    read = guarded("cell", lambda: _read_cell(cell_file), _CELL_S, "see docs/new-cell.md for the keys")
    cell: Cell | None = None
    if isinstance(read, CheckResult):
        yield read
    else:
        found, cell = read
        yield from found
    yield from _cameras(camera, cell if cell_file is not None else None)
    yield from _self_test(cell)


def _row(check: str, run: Rows, seconds: float, help: str = "") -> Iterator[CheckResult]:
    """Yield the rows of a check, or one row that says why it failed."""

    def all_rows() -> tuple[CheckResult, ...]:
        found = run()
        return (found,) if isinstance(found, CheckResult) else tuple(found)

    rows = guarded(check, all_rows, seconds, help)
    yield from (rows,) if isinstance(rows, CheckResult) else rows


def _devices(port: str | None) -> Iterator[CheckResult]:
    from cell.doctor import devices

    yield from _row("serial ports", devices.check_ports, _PORTS_S)
    if port is not None:
        help = "check that it is the controller's port, that the unit is on, and that no other program uses the port"
        yield from _row("controller", lambda: devices.check_controller(port), _CONTROLLER_S, help)


def _cameras(camera: str | None, cell: Cell | None) -> Iterator[CheckResult]:
    from cell.doctor import devices

    yield from _row("cameras", devices.check_cameras, _CAMERAS_S, "docs/cameras.md")
    if camera is not None:
        help = "see docs/cameras.md for the meaning of each reason"
        yield from _row("photograph", lambda: devices.check_photograph(camera, cell), _PHOTOGRAPH_S, help)


def _read_cell(file: Path | None) -> tuple[tuple[CheckResult, ...], Cell]:
    from cell.doctor.cell import check_cell, read_named

    read = read_named(file)
    return tuple(check_cell(read)), read.cell


def _built_in() -> Cell:
    from cell.doctor.cell import read_named

    return read_named(None).cell


def _self_test(cell: Cell | None) -> Iterator[CheckResult]:
    def motion() -> CheckResult:
        from cell.doctor import self_test as selftest

        return selftest.check_motion(cell or _built_in())

    def look() -> CheckResult:
        from cell.doctor import self_test as selftest

        return selftest.check_detection()

    def unit() -> CheckResult:
        from cell.doctor import self_test as selftest

        return selftest.check_unit(cell or _built_in())

    near = "q_start_deg or a body of the cell file may be wrong; a465 check CELL --q=J1,..,J6 lists the closest bodies"
    yield from _row("self-test: plan", motion, _SELF_TEST_S, near)
    yield from _row("self-test: look", look, _SELF_TEST_S, "report this, with the output of --json")
    yield from _row("self-test: unit", unit, _SELF_TEST_S, "check that /dev/pts exists")


def _table_row(finding: CheckResult) -> tuple[str, str, str]:
    """What was found, and below it what would help."""
    help = f"\n-> {finding.help}" if finding.verdict != OK and finding.help else ""
    return finding.check, finding.verdict, finding.found + help
