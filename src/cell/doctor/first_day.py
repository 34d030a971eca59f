"""``a465 doctor``: tick off the first-day checklist by what camera and controller show, and by what a person says.

The controller is only asked: the port passes nothing but questions (`driver.record.tape.QuestionPort`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from arm.errors import ImpossibleError, InputError
from cell.config.cell import Cell
from cell.console import Console
from cell.doctor.checklist import (
    ITEM,
    ITEMS,
    Status,
    checklist_file,
    read_ticks,
    statuses,
    tick_of,
    write_ticks,
)
from cell.doctor.devices import FIRMWARE
from cell.doctor.finding import NOTE, OK, CheckResult
from cell.session.dialogue import answered
from cell.session.homed import may_be_real
from driver.line.clock import Clock
from driver.line.link import ANSWER_S, Link
from driver.line.port import SerialPort
from driver.line.protocol import parse_integer
from driver.mars.identity import gripper_answers, identified, refuse_another
from driver.mars.refusals import refuse_unhomed
from driver.mars.start.read_back import read_back
from driver.mars.stopping import ask_again
from driver.record.tape import QuestionPort, Tape

LONGEST = 200  # characters of an answer
LEAST_LETTERS = 2
NO = "no"
_NO_NAMES = ("y", "yes", "ok", "done", "true", "tried", "measured", "compared")


@dataclass(frozen=True)
class Seen:
    """What was seen of an item.

    Attributes:
        good: whether it is true.
        found: what was found, in words.
        by: what saw it: a port, a camera, or a person.
        stand_in: what was asked in place of the real thing; "" if it was the real thing. Only that is kept.
        untold: whether the unit does not tell, so that only a person can see it; then `good` is false.
    """

    good: bool
    found: str
    by: str
    stand_in: str = ""
    untold: bool = False


def see_unit(port: str, cell: Cell) -> dict[str, Seen]:
    """Ask the unit on a port whether it was homed, and for its registers.

    Raises:
        InputError: the port cannot be opened, no unit with this firmware answers, or it is another arm than the cell's.
        ExecutionStopped: the unit stops answering.
    """
    clock = Clock()
    gate = QuestionPort(SerialPort(port, ANSWER_S, brief=True), Tape(clock))
    with identified(gate, FIRMWARE, clock) as (link, _):
        refuse_another(cell.unit, gripper_answers(link))
        by, stand_in = f"port {port}", "" if may_be_real(port) else "an emulated unit"
        homed, limits = _homed(link, cell), _limits(link, cell)
    return {
        "homed": Seen(*homed, by, stand_in),
        "limits": Seen(limits[0] is True, limits[1], by, stand_in, untold=limits[0] is None),
    }


def _homed(link: Link, cell: Cell) -> tuple[bool, str]:
    """Whether the counters are those of a homed arm, and words."""
    unit = cell.unit
    counts = tuple(ask_again(link, "AP", parse_integer, axis) for axis in unit.axes)
    try:
        refuse_unhomed(unit, counts)
    except ImpossibleError as error:
        return False, str(error)
    degrees = ", ".join(f"{d:.1f}" for d in np.degrees(unit.positions(counts)) + 0.0)
    return True, f"J1 to J6 at [{degrees}] deg by its counters, as long as the unit stays on"


def _limits(link: Link, cell: Cell) -> tuple[bool | None, str]:
    """Whether the registers are those of unit file and cell file, None if the unit does not tell, and words."""
    found = read_back(link, cell.nominal_unit, cell.speed_registers, cell.acceleration_registers)
    if found.wrong:
        more = f"; and {len(found.wrong) - 3} more" if len(found.wrong) > 3 else ""
        return False, "; ".join(found.wrong[:3]) + more + "; a465 home sets them"
    if found.unanswered:
        kinds = ", ".join(dict.fromkeys(name[:-1] for name in found.unanswered))
        return None, f"the unit does not answer for {kinds}; --port with --ask asks a person instead"
    asked = f"{len(found.limits)} limits of speed and acceleration"
    return True, f"{asked} and {found.others} other registers read as set"


def see_camera(photograph: Mapping[str, Any]) -> Seen:
    """Judge the photograph of `cell.doctor.devices.check_photograph`, by the data of its row."""
    by, stand_in = f"camera {photograph['camera']}", photograph["stand_in"]
    if photograph["complaint"]:
        return Seen(False, photograph["complaint"], by, stand_in)
    count = len(photograph["markers"])
    found = (
        f"blur {photograph['blur_px']:.2f} px at the borders of {count} marker{'' if count == 1 else 's'}, neither too "
        f"bright nor too dark; mean grey {photograph['mean_grey']:.0f}"
    )
    return Seen(True, found, by, stand_in)


def ask_person(
    cell: Cell, console: Console, answer: Callable[[], str | None], seen: Mapping[str, Seen]
) -> None:
    """Ask a person for each item that only a person can see; keep each answer at once.

    Args:
        cell: the cell.
        console: for questions.
        answer: returns a typed line, or None if nobody can type.
        seen: by programs; what a real unit does not tell, a person is asked for.

    Raises:
        InputError: nobody answers, an answer is wrong `cell.session.dialogue.TRIES` times, or see `keep`.
    """
    console.say(
        f"{checklist_file(cell.file)}: type your name and what you found; Enter leaves an item as it is, {NO} opens it"
    )
    for status in statuses(cell):
        by_program = seen.get(status.item.name)
        if not (status.item.asks or (by_program and by_program.untold and not by_program.stand_in)):
            continue
        question = f"{status.item.row} (now: {status}): {_QUESTIONS[status.item.name](cell)}"
        said = answered(console, question, _answer, answer, "what was answered before is kept")
        if said is not None:
            keep(cell, {status.item.name: said})


def _answer(line: str) -> Seen:
    if line.lower() == NO:
        return Seen(False, "a person answered no", "a person")
    letters = sum(c.isalpha() for c in line)
    if letters < LEAST_LETTERS or len(line) > LONGEST or not line.isprintable() or line.lower() in _NO_NAMES:
        raise InputError(
            f"{line[:LONGEST]!r}: must be a name and what was found, in a line of up to {LONGEST} characters, or {NO}",
            answer=line[:LONGEST],
        )
    return Seen(True, line, "a person")


def _of_bodies(cell: Cell) -> str:
    return (
        "does no part of the arm protrude from its assumed body by more than the padding of "
        f"{1e3 * cell.arm_padding:g} mm (docs/real-cell.md, step 2)? If one does, answer no and raise arm_padding_mm. "
        "If none does: who measured, and what is the largest protrusion in mm?"
    )


def _of_tool(cell: Cell) -> str:
    stated = "the bodies of its tool file"
    if cell.has_jaws:
        measured = [(name, v) for name, v in ITEM["tool"].against(cell).items() if name.startswith("tool.")]
        stated = ", ".join(f"{name.removeprefix('tool.')} {_shown(value)}" for name, value in measured)
    return (
        f"do your callipers agree with the cell file: {stated}? If a value differs, answer no, correct the file, and "
        "ask again. If all agree: who measured?"
    )


def _of_stop(cell: Cell) -> str:
    return "did you press the emergency stop of this arm while it had power, and the power went off? Who?"


def _of_limits(cell: Cell) -> str:
    return (
        f"this unit does not answer for its registers. Did you measure otherwise that no joint of {cell.unit.name} is "
        "faster than its unit file allows? Who, and how?"
    )


_QUESTIONS = {"bodies": _of_bodies, "tool": _of_tool, "limits": _of_limits, "stop": _of_stop}


def _shown(value: Any) -> str:
    if isinstance(value, list):
        return " x ".join(map(_shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def keep(cell: Cell, seen: Mapping[str, Seen]) -> None:
    """Keep what was seen of the real thing: a tick for what is true, none for what is not.

    Raises:
        InputError: the checklist cannot be read or written.
    """
    before = read_ticks(cell.file)
    ticks = dict(before)
    for name, one in seen.items():
        if one.stand_in or one.untold:
            continue
        if one.good:
            ticks[name] = tick_of(cell, name, one.by, one.found)
        else:
            ticks.pop(name, None)
    if ticks != before:
        write_ticks(cell.file, {item.name: ticks[item.name] for item in ITEMS if item.name in ticks})


def rows_of(cell: Cell, seen: Mapping[str, Seen]) -> tuple[CheckResult, ...]:
    """Keep what was seen, and return a row for each item.

    Raises:
        InputError: see `keep`.
    """
    keep(cell, seen)
    return tuple(_row(cell, status, seen.get(status.item.name)) for status in statuses(cell))


def _row(cell: Cell, status: Status, seen: Seen | None) -> CheckResult:
    item, found = status.item, str(status)
    if seen is not None and seen.stand_in:
        found = f"{found}; {seen.by} is {seen.stand_in}, so this is not kept: {seen.found}"
    elif seen is not None and not seen.good and not status.ticked:
        found = f"open: {seen.found}"
    command = item.command(cell)
    tick = status.tick
    data = {
        "item": item.name,
        "means": item.means,
        "ticked": status.ticked,
        "when": None if tick is None else tick.when or None,
        "by": None if tick is None else tick.by,
        "found": None if tick is None else tick.found,
        "void": list(status.void),
        "command": command,
    }
    return CheckResult(item.row, OK if status.ticked else NOTE, found, command, data)
