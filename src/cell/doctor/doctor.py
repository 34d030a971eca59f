"""``a465 doctor``: check the installation, the devices and a cell. This module imports nothing that may be missing.

Every check has a deadline and becomes a row of the table, even if it fails.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from arm.errors import shortened
from arm.io.outputs import keep_page
from cell.console import WIDTH, Console
from cell.doctor import devices, installation
from cell.doctor.finding import OK, VERDICTS, WRONG, CheckResult, guarded

if TYPE_CHECKING:
    from cell.config.cell import Cell

_HEADER = ("check", "verdict", "found, and what would help")
ROWS = 20  # approximate, for the progress bar
_INSTALL_S, _PORTS_S, _CELL_S = 20.0, 10.0, 60.0
_CONTROLLER_S = 40.0  # three STAMP commands, VER, and the look-up of a host name
_CAMERAS_S, _PHOTOGRAPH_S = 30.0, 100.0  # network cameras are found by broadcast
_UNIT_S, _CHECKLIST_S = 60.0, 60.0  # some 60 queries; the shapes of the arm
_SELF_TEST_S = 60.0  # takes five seconds; more on a slow disk


def doctor_step(
    port: str | None,
    camera: str | None,
    cell_file: Path | None,
    console: Console,
    answer: Callable[[], str | None] | None = None,
    page: Path | None = None,
) -> dict[str, Any]:
    """Run all checks and print a table; return the worst verdict and all rows as JSON types.

    Args:
        port: port of a controller to identify; None: no port is opened.
        camera: selector of a camera to take an image with; None: no camera is opened.
        cell_file: cell or task file, with its first-day checklist; None: the built-in scene, which has none.
        console: output.
        answer: returns a line that a person typed, or None if nobody can; asks for what of the checklist only a person
            sees. None: nobody is asked.
        page: page of the checklist to write; None: none.

    Raises:
        InputError: nobody answers, an answer is wrong too often, or the page cannot be written.
    """
    keep_page(page, cell_file)
    findings: list[CheckResult] = []
    for finding in _findings(port, camera, cell_file, console, answer):
        findings.append(finding)
        console.progress(finding.check, len(findings) / ROWS)
    helps = [f"\n-> {f.help}" if f.verdict != OK and f.help else "" for f in findings]  # below what was found
    rows = [(f.check, f.verdict, f.found + help) for f, help in zip(findings, helps, strict=True)]
    console.table(_HEADER, rows, WIDTH)
    verdict = max((f.verdict for f in findings), key=VERDICTS.index)
    console.say(", ".join(f"{sum(f.verdict == v for f in findings)} {v}" for v in VERDICTS))
    items = [f.data for f in findings if "item" in f.data]
    if page is not None and items:
        from cell.doctor.checklist_page import write_checklist_page

        write_checklist_page(page, str(cell_file), items)
        console.say(f"page: {page}")
    return {
        "verdict": verdict,
        "wrong": [f.check for f in findings if f.verdict == WRONG],
        "open": [item["item"] for item in items if not item["ticked"]],
        "checks": [asdict(f) for f in findings],
    }


def wrong_in(report: dict[str, Any]) -> str:
    """Return in one line what a report has that is wrong, the first of it with what was found."""
    found = next(check["found"] for check in report["checks"] if check["check"] == report["wrong"][0])
    return shortened(f"doctor: wrong: {', '.join(report['wrong'])}; {report['wrong'][0]}: {found}")


def _findings(
    port: str | None,
    camera: str | None,
    cell_file: Path | None,
    console: Console,
    answer: Callable[[], str | None] | None,
) -> Iterator[CheckResult]:
    """Run the checks one after the other; each imports what it needs."""
    answers = False
    photograph = None
    yield guarded("Python", installation.check_python, _INSTALL_S)
    yield guarded("libraries", installation.check_libraries, _INSTALL_S)
    extras = guarded("extras", lambda: tuple(installation.check_extras()), _INSTALL_S)
    yield from (extras,) if isinstance(extras, CheckResult) else extras
    yield guarded("serial ports", devices.check_ports, _PORTS_S)
    if port is not None:
        help = "check that it is the controller's port, that the unit is on, and that no other program uses the port"
        controller = guarded("controller", lambda: devices.check_controller(port), _CONTROLLER_S, help)
        answers = controller.verdict != WRONG
        yield controller
    read = guarded("cell", lambda: _read_cell(cell_file), _CELL_S, "see docs/new-cell.md for the keys")
    found, cell = ((read,), None) if isinstance(read, CheckResult) else read
    yield from found
    yield guarded("cameras", devices.check_cameras, _CAMERAS_S, "docs/cameras.md")
    if camera is not None:
        help, of = "see docs/cameras.md for the meaning of each reason", None if cell_file is None else cell
        photograph = guarded("photograph", lambda: devices.check_photograph(camera, of), _PHOTOGRAPH_S, help)
        yield photograph
    yield from _self_test(cell)
    if cell is not None and cell_file is not None:
        yield from _first_day(cell, port if answers else None, photograph, console, answer)


def _first_day(
    cell: Cell,
    port: str | None,
    photograph: CheckResult | None,
    console: Console,
    answer: Callable[[], str | None] | None,
) -> Iterator[CheckResult]:
    """Tick off the first-day checklist of a cell by what its unit and the photograph show, and by a person's answers.

    Raises:
        InputError: see `doctor_step`.
    """
    first_day = guarded("checklist", _first_day_module, _INSTALL_S)
    if isinstance(first_day, CheckResult):
        yield first_day
        return
    seen: dict[str, Any] = {}
    if photograph is not None and photograph.verdict != WRONG:
        seen["camera"] = first_day.see_camera(photograph.data)
    if port is not None:
        help = "check that the cell file has the unit of this arm, and that the line is not disturbed"
        unit = guarded("unit's state", lambda: first_day.see_unit(port, cell), _UNIT_S, help)
        if isinstance(unit, CheckResult):
            yield unit
        else:
            seen |= unit
    if answer is not None:
        first_day.ask_person(cell, console, answer, seen)
    help = "correct the file, or remove it: then every item is open"
    rows = guarded("checklist", lambda: first_day.rows_of(cell, seen), _CHECKLIST_S, help)
    yield from (rows,) if isinstance(rows, CheckResult) else rows


def _first_day_module() -> ModuleType:
    from cell.doctor import first_day

    return first_day


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
