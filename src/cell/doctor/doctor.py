"""``a465 doctor``: check the installation, the devices and a cell. This module imports nothing that may be missing.

Every check has a deadline and becomes a row of the table, even if it fails.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from cell.console import WIDTH, Console
from cell.doctor import devices, installation
from cell.doctor.finding import OK, VERDICTS, WRONG, CheckResult, guarded

if TYPE_CHECKING:
    from cell.config.cell import Cell

_HEADER = ("check", "verdict", "found, and what would help")
ROWS = 14  # approximate, for the progress bar
_INSTALL_S, _PORTS_S, _CELL_S = 20.0, 10.0, 60.0
_CONTROLLER_S = 40.0  # three STAMP commands, VER, and the look-up of a host name
_CAMERAS_S, _PHOTOGRAPH_S = 30.0, 100.0  # network cameras are found by broadcast
_SELF_TEST_S = 60.0  # takes five seconds; more on a slow disk


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
    helps = [f"\n-> {f.help}" if f.verdict != OK and f.help else "" for f in findings]  # below what was found
    rows = [(f.check, f.verdict, f.found + help) for f, help in zip(findings, helps, strict=True)]
    console.table(_HEADER, rows, WIDTH)
    verdict = max((f.verdict for f in findings), key=VERDICTS.index)
    console.say(", ".join(f"{sum(f.verdict == v for f in findings)} {v}" for v in VERDICTS))
    return {
        "verdict": verdict,
        "wrong": [f.check for f in findings if f.verdict == WRONG],
        "checks": [asdict(f) for f in findings],
    }


def _findings(port: str | None, camera: str | None, cell_file: Path | None) -> Iterator[CheckResult]:
    """Run the checks one after the other; each imports what it needs."""
    yield guarded("Python", installation.check_python, _INSTALL_S)
    yield guarded("libraries", installation.check_libraries, _INSTALL_S)
    extras = guarded("extras", lambda: tuple(installation.check_extras()), _INSTALL_S)
    yield from (extras,) if isinstance(extras, CheckResult) else extras
    yield guarded("serial ports", devices.check_ports, _PORTS_S)
    if port is not None:
        help = "check that it is the controller's port, that the unit is on, and that no other program uses the port"
        yield guarded("controller", lambda: devices.check_controller(port), _CONTROLLER_S, help)
    read = guarded("cell", lambda: _read_cell(cell_file), _CELL_S, "see docs/new-cell.md for the keys")
    found, cell = ((read,), None) if isinstance(read, CheckResult) else read
    yield from found
    yield guarded("cameras", devices.check_cameras, _CAMERAS_S, "docs/cameras.md")
    if camera is not None:
        help, of = "see docs/cameras.md for the meaning of each reason", None if cell_file is None else cell
        yield guarded("photograph", lambda: devices.check_photograph(camera, of), _PHOTOGRAPH_S, help)
    yield from _self_test(cell)


def _read_cell(file: Path | None) -> tuple[tuple[CheckResult, ...], Cell]:
    from cell.doctor.cell import check_cell

    return check_cell(file)


def _self_test(cell: Cell | None) -> Iterator[CheckResult]:
    """Run the self-test in a cell; None: the built-in one."""

    def tests() -> ModuleType:
        from cell.doctor import self_test

        return self_test

    near = "q_start_deg or a body of the cell file may be wrong; a465 check CELL --q=J1,..,J6 lists the closest bodies"
    report = "report this, with the output of --json"
    yield guarded(
        "self-test: plan", lambda: tests().check_motion(cell or _read_cell(None)[1]), _SELF_TEST_S, near
    )
    yield guarded("self-test: look", lambda: tests().check_detection(), _SELF_TEST_S, report)
    pty = "check that /dev/pts exists"
    yield guarded(
        "self-test: unit", lambda: tests().check_unit(cell or _read_cell(None)[1]), _SELF_TEST_S, pty
    )
