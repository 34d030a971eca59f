"""``a465 doctor``: is everything there that a user needs, and does it work? Imports nothing that may be missing.

Every check has a deadline and ends as a row of the table, whatever happens in it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cell.console import WIDTH, Console
from cell.doctor.finding import OK, VERDICTS, WRONG, Finding, guarded

if TYPE_CHECKING:
    from cell.config.cell import Cell

_HEADER = ("check", "verdict", "found, and what would help")
ROWS = 14  # about, for the progress bar
_INSTALL_S, _PORTS_S, _CELL_S = 20.0, 10.0, 60.0
_CONTROLLER_S = 40.0  # three stamps, a version, and the look-up of a host's name
_CAMERAS_S, _PHOTOGRAPH_S = 30.0, 100.0  # cameras on a network are searched for by broadcast
_SELF_TEST_S = 60.0  # five seconds, on a slow disk

Rows = Callable[[], "Finding | Iterable[Finding]"]


def doctor_step(
    port: str | None, camera: str | None, cell_file: Path | None, console: Console
) -> dict[str, Any]:
    """Look at everything and print a table; the worst verdict and all rows.

    Args:
        port: of a controller to ask who it is; None: no port is opened.
        camera: selector of a camera to take a photograph with; None: no camera is opened.
        cell_file: cell or task file; None: the built-in scene.
    """
    findings: list[Finding] = []
    for finding in _look(port, camera, cell_file):
        findings.append(finding)
        console.progress(finding.check, len(findings) / ROWS)
    console.table(_HEADER, list(_rows(findings)))
    verdict = max((f.verdict for f in findings), key=VERDICTS.index)
    counted = ", ".join(f"{sum(f.verdict == v for f in findings)} {v}" for v in VERDICTS)
    console.say(counted)
    return {
        "verdict": verdict,
        "wrong": [f.check for f in findings if f.verdict == WRONG],
        "checks": [f.to_json() for f in findings],
    }


def _look(port: str | None, camera: str | None, cell_file: Path | None) -> Iterator[Finding]:
    """Every check, one after the other; each imports what it needs."""
    from cell.doctor import installation as install

    yield from _row("Python", install.python_finding, _INSTALL_S)
    yield from _row("libraries", install.libraries_finding, _INSTALL_S)
    yield from _row("extras", install.extra_findings, _INSTALL_S)
    yield from _devices(port)
    read = guarded("cell", lambda: _read_cell(cell_file), _CELL_S, "docs/new-cell.md says what each key is")
    cell: Cell | None = None
    if isinstance(read, Finding):
        yield read
    else:
        found, cell = read
        yield from found
    yield from _cameras(camera, cell if cell_file is not None else None)
    yield from _self_test(cell)


def _row(check: str, look: Rows, seconds: float, help: str = "") -> Iterator[Finding]:
    """The rows of a check, or that it failed."""

    def all_rows() -> tuple[Finding, ...]:
        found = look()
        return (found,) if isinstance(found, Finding) else tuple(found)

    rows = guarded(check, all_rows, seconds, help)
    yield from (rows,) if isinstance(rows, Finding) else rows


def _devices(port: str | None) -> Iterator[Finding]:
    from cell.doctor import devices

    yield from _row("serial ports", devices.ports_finding, _PORTS_S)
    if port is not None:
        help = "is it the controller's port, is the unit on, has another program got it?"
        yield from _row("controller", lambda: devices.controller_finding(port), _CONTROLLER_S, help)


def _cameras(camera: str | None, cell: Cell | None) -> Iterator[Finding]:
    from cell.doctor import devices

    yield from _row("cameras", devices.cameras_finding, _CAMERAS_S, "docs/cameras.md")
    if camera is not None:
        help = "docs/cameras.md says what each reason means"
        yield from _row("photograph", lambda: devices.photograph_finding(camera, cell), _PHOTOGRAPH_S, help)


def _read_cell(file: Path | None) -> tuple[tuple[Finding, ...], Cell]:
    from cell.doctor.cell import cell_findings, read_named

    read = read_named(file)
    return tuple(cell_findings(read)), read.cell


def _built_in() -> Cell:
    from cell.doctor.cell import read_named

    return read_named(None).cell


def _self_test(cell: Cell | None) -> Iterator[Finding]:
    def motion() -> Finding:
        from cell.doctor import self_test as selftest

        return selftest.motion_finding(cell or _built_in())

    def look() -> Finding:
        from cell.doctor import self_test as selftest

        return selftest.look_finding()

    def unit() -> Finding:
        from cell.doctor import self_test as selftest

        return selftest.unit_finding(cell or _built_in())

    near = "q_start_deg or a body in the cell file; a465 check CELL --q=J1,..,J6 tells what is how near"
    yield from _row("self-test: plan", motion, _SELF_TEST_S, near)
    yield from _row("self-test: look", look, _SELF_TEST_S, "tell us, with --json")
    yield from _row("self-test: unit", unit, _SELF_TEST_S, "is /dev/pts there?")


def _rows(findings: Iterable[Finding]) -> Iterator[tuple[str, str, str]]:
    """Lines of the table, 80 columns at most: what was found, and below it what would help."""
    findings = list(findings)
    room = WIDTH - max(len(f.check) for f in findings) - len(_HEADER[1]) - 4
    for finding in findings:
        lines = _wrapped(finding.found, room)
        if finding.verdict != OK and finding.help:
            lines += _wrapped(f"-> {finding.help}", room)
        for number, line in enumerate(lines):
            yield (finding.check, finding.verdict, line) if number == 0 else ("", "", line)


def _wrapped(text: str, room: int) -> list[str]:
    return textwrap.wrap(text, room, break_on_hyphens=False) or [""]
