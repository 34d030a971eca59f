"""Ask a unit where its arm is, without setting or moving anything; in words and as JSON types."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from arm.controller.unit import UNITS, Unit, load_unit
from arm.se3 import Array
from cell.config.cell import Cell
from cell.console import Console
from cell.files.task import cell_of
from driver.execution.rest import SAMPLE_S, STILL_COUNTS, farthest
from driver.line.link import Link
from driver.line.protocol import ARM_POWER_OFF, AXIS_ERROR, MOTION_STOP, Status, parse_integer
from driver.mars.identity import axis_of_gripper, gripper_answers, refuse_another
from driver.mars.refusals import is_unhomed
from driver.mars.stopping import ask_again, read_status

BY_CELL, BY_GRIPPER, BY_LOG = "cell file", "axis of its gripper", "log"


@dataclass(frozen=True, eq=False)
class Reading:
    """State of an arm.

    Attributes:
        status: status word; None: not known.
        counts: counters of the axes (6,); None: not known.
        moving: whether the counters change.
        unit: unit with its calibration; None: not known.
        unit_by: how `unit` is known: `BY_CELL`, `BY_GRIPPER` or `BY_LOG`.
        jaws: ADC counts of the jaws; None: not known, or no jaws.
        cell: whose tool the arm carries; None: not known.
    """

    status: Status | None
    counts: tuple[int, ...] | None
    moving: bool = False
    unit: Unit | None = None
    unit_by: str = ""
    jaws: int | None = None
    cell: Cell | None = field(default=None, repr=False)

    def q(self) -> Array | None:
        """Configuration by the counters (6,), rad; None if the unit is not known, or the counters mean nothing."""
        if self.unit is None or self.counts is None or not self.referenced:
            return None
        return self.unit.positions(self.counts)

    @property
    def referenced(self) -> bool | None:
        """False if the counters are as after power-up; None if they are not known. That True is right is assumed."""
        if self.counts is None:
            return None
        unit = self.unit or load_unit(UNITS[0])
        return not is_unhomed(unit, self.counts)

    def to_json(self) -> dict[str, Any]:
        """Return the state as JSON types; what is not known is None."""
        status, q = self.status, self.q()
        jaws = (
            None if self.unit is None or self.jaws is None else self.unit.gripper.fraction_closed(self.jaws)
        )
        T = None if self.cell is None or q is None else self.cell.robot().T_base_tool(q)
        wide = None
        if jaws is not None and self.cell is not None and self.cell.has_jaws:
            wide = round(1e3 * self.cell.gripper.width(jaws), 2)
        return {
            "unit": None if self.unit is None else self.unit.name,
            "unit_by": self.unit_by or None,
            "arm_power": None if status is None else not status.word & ARM_POWER_OFF,
            "motion_stop": None if status is None else bool(status.word & MOTION_STOP),
            "axis_error": None if status is None else bool(status.word & AXIS_ERROR),
            "faults": [] if status is None else list(status.faults()),
            "moving": self.moving or (status is not None and status.busy),
            "referenced": self.referenced,
            "counts": None if self.counts is None else list(self.counts),
            "q_deg": None if q is None else [round(float(d), 3) + 0.0 for d in np.degrees(q)],
            "tool_mm": None if T is None else [round(1e3 * float(v), 2) + 0.0 for v in T[:3, 3]],
            "T_base_tool": None if T is None else T.tolist(),
            "jaws_fraction_closed": None if jaws is None else round(jaws, 3),
            "jaws_mm": wide,
        }


def print_reading(state: dict[str, Any], console: Console) -> None:
    """Print a state as of `Reading.to_json`."""
    say = console.say
    if state["arm_power"] is not None:
        power = "on" if state["arm_power"] else "OFF"
        pressed = "PRESSED" if state["motion_stop"] else "not pressed"
        errors = "an axis is in ERROR" if state["axis_error"] else "no axis in error"
        say(
            f"arm power {power}, motion stop {pressed}, {errors}, {'MOVING' if state['moving'] else 'at rest'}"
        )
        if state["arm_power"]:
            say(
                "whether the motors hold the arm is not reported: a465 release and 20 min of rest switch them off"
            )
    if state["unit"] is not None:
        doubt = "" if state["unit_by"] == BY_CELL else "; --cell CELL states it"
        say(f"unit: {state['unit']}, by the {state['unit_by']}{doubt}")
    if state["counts"] is None:
        say("position: not known")
        return
    if not state["referenced"]:
        say("NOT HOMED since it was switched on: its position is not known")
        return
    if state["q_deg"] is None:
        say(f"counters: {', '.join(map(str, state['counts']))}; angles need --cell CELL")
    else:
        say(
            f"J1 to J6: {', '.join(f'{d:.2f}' for d in state['q_deg'])} deg, if it was homed since it was switched on"
        )
    if state["tool_mm"] is not None:
        x, y, z = state["tool_mm"]
        along = ", ".join(f"{row[2] + 0.0:.3f}" for row in state["T_base_tool"][:3])
        say(f"tool: x {x:.1f}, y {y:.1f}, z {z:.1f} mm, pointing along [{along}]")
    if state["jaws_mm"] is not None:
        say(f"jaws: {state['jaws_mm'] + 0.0:.1f} mm apart")
    elif state["jaws_fraction_closed"] is not None:
        say(f"jaws: {round(100 * state['jaws_fraction_closed'])} % closed")


def read_cell_of(file: Path | None) -> Cell | None:
    """Return the cell of a cell or task file, or None without a file.

    Raises:
        InputError: the file is neither, or is wrong.
    """
    return None if file is None else cell_of(file)


def read_arm(link: Link, cell: Cell | None = None) -> Reading:
    """Ask an identified unit for its state, by queries alone.

    Args:
        link: to the unit.
        cell: cell of the arm; None: the unit is recognised by the axis of its gripper, if it has one.

    Raises:
        InputError: the unit is another than that of the cell.
        ExecutionStopped: an answer is missing.
    """
    answers = gripper_answers(link)
    if cell is not None:
        refuse_another(cell.unit, answers)
        unit: Unit | None = cell.unit
        by = BY_CELL
    else:
        unit, by = _unit_with_gripper_on(axis_of_gripper(answers)), BY_GRIPPER
    axes = (unit or load_unit(UNITS[0])).axes
    status, before = read_status(link), _counters(link, axes)
    link.wait(SAMPLE_S)
    counts = _counters(link, axes)
    jaws = None
    if unit is not None and unit.gripper.fitted and answers.get(unit.gripper.axis) is not None:
        jaws = ask_again(link, "AP", parse_integer, unit.gripper.axis)
    moving = farthest(before, counts) > STILL_COUNTS
    return Reading(status, counts, moving, unit, by if unit is not None else "", jaws, cell)


def _counters(link: Link, axes: tuple[str, ...]) -> tuple[int, ...]:
    return tuple(ask_again(link, "AP", parse_integer, axis) for axis in axes)


def _unit_with_gripper_on(axis: str | None) -> Unit | None:
    """The one unit whose gripper is on that axis."""
    found = [unit for unit in map(load_unit, UNITS) if unit.gripper.axis == axis]
    return found[0] if len(found) == 1 else None
