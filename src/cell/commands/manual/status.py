"""``a465 status``: where the arm is and what it is up to. Nothing is set or moved.

While another a465 has the port, the unit cannot be asked: what that program's wire log says last is shown instead.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from arm.controller.unit import noted_unit
from arm.errors import InputError
from arm.io.claim import Claimed, Holder
from cell.commands.manual.reading import BY_CELL, BY_LOG, Reading, print_reading, read_arm, read_cell_of
from cell.config.cell import Cell
from cell.console import Console
from cell.doctor.devices import FIRMWARE
from cell.session.ports import PortAndPlace, choose_port
from driver.log.latest import Latest, read_latest
from driver.mars.identity import identified


def status_step(given: PortAndPlace, console: Console) -> dict[str, Any]:
    """Report the state of the arm on a port, or of the program that has the port; return it as JSON types.

    Args:
        given: port of the controller, and a cell or task file with its unit, calibration and tool.
        console: output.

    Raises:
        InputError: the cell file is wrong, the port cannot be opened, or no unit answers there.
        ExecutionStopped: the unit stops answering.
    """
    cell = read_cell_of(given.place)
    port = choose_port(given.port, given.place, console)
    try:
        return _asked(port, cell, console)
    except Claimed as error:
        if error.holder is None:
            raise
        return _told_by(error.holder, port, cell, console)


def _asked(port: str, cell: Cell | None, console: Console) -> dict[str, Any]:
    with console.doing("asking"), identified(port, FIRMWARE, brief=True) as (link, version):
        began = time.monotonic()
        link.synchronise()
        answer_s = time.monotonic() - began
        state = read_arm(link, cell).to_json()
    console.say(f"{port}: {version}; answers in {1e3 * answer_s:.0f} ms; no a465 has the port")
    print_reading(state, console)
    return {"port": port, "held_by": None, "version": version, "doing": None, "age_s": 0.0, **state}


def _told_by(holder: Holder, port: str, cell: Cell | None, console: Console) -> dict[str, Any]:
    console.say(f"{port}: in use by {holder.describe()}")
    latest = Latest()
    if holder.log:
        with suppress(InputError):  # not written yet, or removed
            latest = read_latest(Path(holder.log))
    unit = cell.unit if cell is not None else None
    if unit is None and latest.unit:
        with suppress(InputError):
            noted = noted_unit(latest.unit)
            unit = noted and noted.calibrated(latest.unit.get("joint_offsets_rad", [0.0] * 6))
    by = "" if unit is None else BY_LOG if cell is None else BY_CELL
    state = Reading(latest.status, latest.counts, False, unit, by, latest.jaws, cell).to_json()
    doing = latest.step or None
    if holder.log:
        last = f", the last step that began: {doing}" if doing else ""
        console.say(f"its log, {latest.age_s:.1f} s ago{last}")
        print_reading(state, console)
    held = {**asdict(holder), "folder": holder.folder or None, "log": holder.log or None}
    return {"port": port, "held_by": held, "version": None, "doing": doing, "age_s": latest.age_s, **state}
