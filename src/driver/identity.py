"""What is on the other side of a link, learnt without touching it; and what it admits to hold."""

from __future__ import annotations

from typing import Any

from arm.errors import ExecutionStopped, InputError
from arm.unit import Unit
from driver.link import Link
from driver.protocol import encode, parse_integer


def identify(link: Link, firmware: str) -> str:
    """Learn by ECHO, STAMP and VER alone that a controller with this firmware answers; its full text.

    Sets ``link.identified``, without which the link sends nothing else.

    Raises:
        InputError: nothing answers like a MARS, or the firmware is another's.
    """
    try:
        link.send("")  # ends whatever half line an earlier user left
        link.send(encode("ECHO", 0))
        link.synchronise(attempts=3)  # after power-up the unit sends noise that can spoil an answer
        version = link.ask("VER")
    except ExecutionStopped as error:
        raise InputError(
            f"port {link.url}: does not answer like a {firmware}; is it one, and is it on?",
            port=link.url,
            reason=error.data.get("reason"),
        ) from error
    if version.split()[:1] != [firmware]:
        raise InputError(
            f"port {link.url}: firmware {version!r} is not {firmware}; other controllers have other units of speed",
            port=link.url,
            version=version,
        )
    link.identified, link.restarted = True, False
    return version


def read_back(link: Link, unit: Unit) -> dict[str, Any]:
    """What the unit answers about registers just set to its defaults; None where it answers nothing.

    Which registers a MARS-8 answers is not known (fact sheet, section 6), so silence proves nothing; a wrong value
    does.

    Raises:
        ExecutionStopped: a register holds another value than was sent.
    """
    answers: dict[str, Any] = {"COORDDISCONT": link.ask_optional("COORDDISCONT")}
    for axis, value in zip(unit.axes, unit.speed_registers, strict=True):
        text = answers[f"REGMS{axis}"] = link.ask_optional("REGMS", axis)
        if text is None:
            break  # a unit that does not answer one will not answer the others
        if parse_integer(text) != value:
            raise ExecutionStopped(f"REGMS{axis} reads {text} after {value} was set", axis=axis, value=value)
    return answers
