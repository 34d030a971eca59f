"""``a465 view --live``: the cell in 3D with the arm where its unit reports it. Nothing is set or moved.

The port is opened for each reading and closed again, and others who want it meanwhile wait, so that commands beside the
arm can be given while the page is open. While another a465 has the port, what its wire log says last is shown.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from arm.errors import InputError
from arm.io.claim import Claimed
from cell.commands.manual.reading import BY_CELL, Reading, read_arm
from cell.config.cell import Cell
from cell.console import Console
from cell.doctor.devices import FIRMWARE
from cell.files.task import cell_of
from cell.live.view import live_view
from cell.preview.of_place import photograph_for, place_shown, resting, world_of
from cell.preview.page import preview_page
from cell.session.ports import choose_port
from driver.line.protocol import ARM_POWER_OFF, MOTION_STOP
from driver.log.latest import read_latest
from driver.mars.identity import identified
from plan.collision.world import World

EVERY_S = 0.3  # from the end of a reading to the next
NOT_HOMED = "NOT HOMED since it was switched on: where the arm is, is not known"


def view_live_step(
    file: Path,
    look: Path | None,
    image: Path | None,
    port: str | None,
    live_port: int | None,
    seconds: float | None,
    console: Console,
) -> dict[str, Any]:
    """Serve the page of a cell until Ctrl-C, and return a summary as JSON types.

    Args:
        file: cell, task or program file.
        look: detected boards and cubes to add.
        image: photograph of the cell's camera.
        port: of the controller; see `cell.session.ports`.
        live_port: see `cell.live.view.live_view`.
        seconds: wall time after which it ends; None: at Ctrl-C.
        console: output.

    Raises:
        InputError: a file or value is wrong, the port cannot be opened, or no unit answers there.
        ExecutionStopped: the unit stops answering.
    """
    if seconds is not None and not 0.0 < seconds < math.inf:
        raise InputError(f"--seconds = {seconds:g}: must be above 0", option="seconds", value=seconds)
    cell = cell_of(file)
    setting, drawn, q_start, _ = place_shown(file, look)
    if image is not None:
        drawn["photograph"] = photograph_for(drawn, image, file)
    port = choose_port(port, file, console)
    plan, world = resting(setting, q_start, "where the unit reports the arm", file.stem), world_of(setting)
    robots = setting.scene.robot_open, setting.scene.robot_holding
    over = math.inf if seconds is None else time.monotonic() + seconds
    count = 0
    with live_view(console, live_port or 0) as live:
        live.place(plan, cell.unit, lambda mark: preview_page(plan, *robots, cell.unit, live=mark, **drawn))
        with suppress(KeyboardInterrupt):
            while time.monotonic() < over:
                reading, by = _reading(port, cell)
                live.reading(*_told(reading, by, world))
                count += 1
                time.sleep(max(0.0, min(EVERY_S, over - time.monotonic())))
    return {"port": port, "readings": count}


def _reading(port: str, cell: Cell) -> tuple[Reading, str]:
    """Return the arm's state, and who has the port ("" if nobody)."""
    try:
        with identified(port, FIRMWARE, brief=True) as (link, _):
            return read_arm(link, cell), ""
    except Claimed as error:
        if error.holder is None:
            raise
        status = counts = jaws = None
        doing = ""
        if error.holder.log:
            with suppress(InputError):  # not written yet, or removed
                latest = read_latest(Path(error.holder.log))
                status, counts, jaws, doing = latest.status, latest.counts, latest.jaws, latest.step
        by = f"{error.holder.command}{f': {doing}' if doing else ''}"
        return Reading(status, counts, False, cell.unit, BY_CELL, jaws, cell), by


def _told(reading: Reading, by: str, world: World) -> tuple[tuple[int, ...] | None, str]:
    """Return counts, None if they mean nothing, and what is said of them."""
    q, status = reading.q(), reading.status
    facts = [by] if by else []
    if status is not None:
        facts += ["arm power OFF"] if status.word & ARM_POWER_OFF else []
        facts += ["motion stop PRESSED"] if status.word & MOTION_STOP else []
    facts += ["moving"] if reading.moving else []
    if q is None:
        return None, " · ".join([*facts, "position not known" if reading.counts is None else NOT_HOMED])
    closest = world.distance(q)
    near = "inside each other" if closest.value <= 0.0 else f"{1e3 * closest.value:.1f} mm"
    return reading.counts, " · ".join([*facts, f"closest {closest.pair[0]} - {closest.pair[1]}: {near}"])
