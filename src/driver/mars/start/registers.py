"""Set registers of the unit and read them back where it answers: an echo proves the line, not the register.

Which registers a MARS-8 can be asked for is not known (docs/sources.md, "What is not known of the controller"). So a
missing answer proves nothing, but a wrong value does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from arm.errors import ExecutionStopped
from driver.line.link import Link

_REGISTER = re.compile(r"(REG[A-Z0-9]+|IDLEREL|COORDDISCONT):(-?\d+)")
READ_BACKS = 2  # attempts to read a register back, as an answer may be damaged on the line


class Registers:
    """Sets registers over one link and reads them back.

    Attributes:
        answers: register name to the unit's answer, or to None where it does not answer; since the last `forget`.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._answered: dict[str, bool] = {}  # by kind of register: whether the unit answers
        self.answers: dict[str, str | None] = {}

    def forget(self) -> None:
        """Forget all answers: another unit may be connected now."""
        self._answered = {}
        self.answers = {}

    def tell(self, *lines: str) -> None:
        """Send lines that do no harm if sent twice, and read back the registers among them.

        Raises:
            NoAnswer, LinkLost, LineDamaged: as `Link.tell`.
            ExecutionStopped: a register holds another value than was set; reason ``register``.
        """
        self._link.tell(*lines)
        values = registers_in(lines)
        for attempt in range(READ_BACKS):
            wrong = self._wrong(values)
            if not wrong:
                return
            values = {name: values[name] for name in wrong}
            if attempt + 1 == READ_BACKS:
                name = wrong[0]
                raise ExecutionStopped(
                    f"register {name} reads {self.answers[name]} after {values[name]} was set, though the echo was "
                    "right: the unit does not keep its registers; switch it off and on",
                    register=name,
                    value=values[name],
                    answer=self.answers[name],
                    reason="register",
                )

    def _wrong(self, values: Mapping[str, int]) -> list[str]:
        """Names of the registers that read another value."""
        self.ask(values)
        texts = {name: self.answers.get(name) for name in values}
        return [name for name, text in texts.items() if text is not None and not reads(text, values[name])]

    def ask(self, names: Iterable[str]) -> None:
        """Ask for one register of each new kind, then for the others of the kinds that are answered.

        Raises:
            NoAnswer, LinkLost: as `Link.ask_all`.
        """
        left = list(names)
        first = {_kind(name): name for name in reversed(left) if _kind(name) not in self._answered}
        for name, text in self._link.ask_all(list(first.values())).items():
            self.answers[name] = text
            self._answered[_kind(name)] = text is not None
        more = [name for name in left if self._answered[_kind(name)] and name not in first.values()]
        self.answers.update(self._link.ask_all(more))


def registers_in(lines: Iterable[str]) -> dict[str, int]:
    """Return the registers that lines set, each with its value."""
    return {found[1]: int(found[2]) for line in lines if (found := _REGISTER.fullmatch(line))}


def _kind(name: str) -> str:
    """Register name without its axis: REGMS for REGMSA."""
    return name[:-1] if name.startswith("REG") else name


def reads(text: str, value: int) -> bool:
    """Whether the answer for a register is a number of this value."""
    try:
        return float(text) == value
    except ValueError:
        return False
