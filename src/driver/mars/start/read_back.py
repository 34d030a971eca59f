"""Read a unit's registers and compare them with what this project would set. Nothing is set."""

from __future__ import annotations

from dataclasses import dataclass

from arm.controller.unit import Unit
from driver.line.link import Link
from driver.mars.start.registers import Registers, reads, registers_in
from driver.mars.start.startup import axis_lines, gripper_lines, limit_lines


@dataclass(frozen=True)
class ReadBack:
    """Registers as a unit has them.

    Attributes:
        limits: the speed and acceleration registers (REGMS, REGACC) of the arm's axes that were answered, by name.
        unanswered: those that were not, which proves nothing.
        others: number of other registers that were answered.
        wrong: a line for each register with another value than expected.
    """

    limits: dict[str, str]
    unanswered: tuple[str, ...]
    others: int
    wrong: tuple[str, ...]


def read_back(link: Link, unit: Unit, speed: tuple[int, ...], acceleration: tuple[int, ...]) -> ReadBack:
    """Ask an identified unit for its registers.

    Args:
        link: to the unit.
        unit: what is expected.
        speed, acceleration: limits of the cell, (6,); those of the unit's file are right, too: they are set before.

    Raises:
        NoAnswer, LinkLost: as `Link.ask_all`.
    """
    first = registers_in([*axis_lines(unit), *gripper_lines(unit)])
    limits = registers_in(limit_lines(unit, speed, acceleration))
    registers = Registers(link)
    registers.ask(first)
    texts = {name: text for name in first if (text := registers.answers.get(name)) is not None}
    wrong = []
    for name, text in texts.items():
        expected = sorted({first[name], limits.get(name, first[name])})
        if not any(reads(text, value) for value in expected):
            wrong.append(f"{name} reads {text}, must be {' or '.join(map(str, expected))}")
    return ReadBack(
        {name: texts[name] for name in limits if name in texts},
        tuple(name for name in limits if name not in texts),
        len(texts.keys() - limits.keys()),
        tuple(wrong),
    )
