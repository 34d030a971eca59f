"""Registers that are told to the unit, and read back where it answers: an echo tells of the line, not of the unit.

Which registers a MARS-8 answers is not known (fact sheet, section 6), so silence proves nothing; a wrong value does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from arm.errors import ExecutionStopped
from driver.line.link import Link

_REGISTER = re.compile(r"(REG[A-Z0-9]+|IDLEREL|COORDDISCONT):(-?\d+)")
LOOKS = 2  # one answer may be damaged on the line


class Registers:
    """Tells registers over one link.

    Attributes:
        answers: what the unit answers, of all that were told since `learn`: name to text; None where it says nothing.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._answered: dict[str, bool] = {}  # by kind of register
        self.answers: dict[str, str | None] = {}

    def forget(self) -> None:
        """What the unit answers is asked anew: it may be another one."""
        self._answered = {}
        self.answers = {}

    def tell(self, *lines: str) -> None:
        """Send lines that may be sent twice, and read back the registers among them.

        Raises:
            NoAnswer, LinkLost, LineDamaged: as `Link.tell`.
            ExecutionStopped: a register holds another value than was told; reason ``register``.
        """
        self._link.tell(*lines)
        told = {found[1]: int(found[2]) for line in lines if (found := _REGISTER.fullmatch(line))}
        for look in range(LOOKS):
            wrong = self._wrong(told)
            if not wrong:
                return
            told = {name: told[name] for name in wrong}
            if look + 1 == LOOKS:
                name = wrong[0]
                raise ExecutionStopped(
                    f"register {name} reads {self.answers[name]} after {told[name]} was set, though the line came back "
                    "right: the unit does not hold what it is told; switch it off and on",
                    register=name,
                    value=told[name],
                    answer=self.answers[name],
                    reason="register",
                )

    def _wrong(self, told: Mapping[str, int]) -> list[str]:
        """Names whose answers are other values."""
        self._ask(told)
        texts = {name: self.answers.get(name) for name in told}
        return [name for name, text in texts.items() if text is not None and not _is(text, told[name])]

    def _ask(self, names: Iterable[str]) -> None:
        """One of each kind that was not asked yet, then all of those kinds that are answered."""
        left = list(names)
        first = {_kind(name): name for name in reversed(left) if _kind(name) not in self._answered}
        for name, text in self._link.ask_all(list(first.values())).items():
            self.answers[name] = text
            self._answered[_kind(name)] = text is not None
        more = [name for name in left if self._answered[_kind(name)] and name not in first.values()]
        self.answers.update(self._link.ask_all(more))


def _kind(name: str) -> str:
    """REGMS of REGMSA."""
    return name[:-1] if name.startswith("REG") else name


def _is(text: str, value: int) -> bool:
    try:
        return float(text) == value
    except ValueError:
        return False
