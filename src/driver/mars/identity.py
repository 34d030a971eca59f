"""Identify what a link is connected to, without changing anything there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, InputError
from driver.line.clock import Clock
from driver.line.link import ANSWER_S, Link
from driver.line.manners import Manners, learn_manners
from driver.line.port import Port, SerialPort
from driver.line.protocol import encode
from driver.line.wire_log import WireLog


def identify(link: Link, firmware: str) -> tuple[str, Manners]:
    """Check by ECHO, STAMP and VER alone that a controller with this firmware answers.

    Sets ``link.identified``, without which the link sends nothing else.

    Returns:
        The full firmware text, and how the unit echoes (`Manners`).

    Raises:
        InputError: nothing answers like a MARS, or the firmware differs.
    """
    try:
        link.send("")  # ends a partial line of an earlier program
        link.send(encode("ECHO", 0))
        link.synchronise(attempts=3)  # noise of the unit after power-up can damage an answer
        version = link.ask("VER")
        manners = learn_manners(link)
    except ExecutionStopped as error:
        why = f"port {link.url}: does not answer like a {firmware}; is the controller connected and switched on?"
        raise InputError(why, port=link.url, reason=error.data.get("reason")) from error
    if version.split()[:1] != [firmware]:
        why = f"port {link.url}: firmware {version!r} is not {firmware}; other controllers use other units of speed"
        raise InputError(why, port=link.url, version=version)
    link.identified, link.restarted = True, False
    return version, manners


@contextmanager
def identified(
    url: str | Port,
    firmware: str,
    clock: Clock | None = None,
    log: WireLog | None = None,
    brief: bool = False,
) -> Iterator[tuple[Link, str]]:
    """Open a port to ask the unit on it, and identify that; yield the link and the firmware text.

    Nothing is set, and no STOP is sent at the end, however the block ends. `clock` and `log` are those of `Link`, and
    so is an open port in place of its URL. With `brief`, for a block that ends at once, others who want the port wait
    for it.

    Raises:
        InputError: the port cannot be opened, or see `identify`.
        LinkLost: the port is lost meanwhile.
    """
    port = url
    if brief and isinstance(url, str):
        port = SerialPort(url, ANSWER_S, None if log is None else log.path, brief=True)
    link = Link(port, clock or Clock(), log)
    try:
        version, _ = identify(link, firmware)
        yield link, version
    finally:
        link.close()


GRIPPER_AXES = ("G", "H")  # axes that the units' grippers are connected to


def gripper_answers(link: Link) -> dict[str, str | None]:
    """Ask for the position of each possible gripper axis; None where the unit does not answer.

    An axis without a gripper reads 0. A gripper's converter never reads 0 (true of the emulator, assumed of units).
    """
    return {axis: link.ask_optional("AP", axis) for axis in GRIPPER_AXES}


def refuse_another(unit: Unit, answers: Mapping[str, str | None]) -> None:
    """Refuse a unit whose gripper is on another axis than expected. Any other answer proves nothing.

    Args:
        unit: the expected unit.
        answers: of `gripper_answers`.

    Raises:
        InputError: there is no gripper on the expected axis, but one on another.
    """
    own = unit.gripper.axis
    others = [axis for axis, text in answers.items() if axis != own and _has_gripper(text)]
    if others and not _has_gripper(answers.get(own)):
        read = [f"AP{axis} {'unanswered' if text is None else f'= {text}'}" for axis, text in answers.items()]
        why = (
            f"unit = {unit.name}: its gripper is on axis {own}, but this arm has it on axis {others[0]} "
            f"({', '.join(read)}): this is another arm, with other zeros and registers. Correct unit in the "
            "cell file; if unit is right, the controller was set up for another arm: switch it off and on"
        )
        raise InputError(why, unit=unit.name, answers=dict(answers))


def axis_of_gripper(answers: Mapping[str, str | None]) -> str | None:
    """Return the one axis that has a gripper by the answers of `gripper_answers`; None if it is not one."""
    fitted = [axis for axis, text in answers.items() if _has_gripper(text)]
    return fitted[0] if len(fitted) == 1 else None


def _has_gripper(text: str | None) -> bool:
    return text is not None and text.strip().lstrip("-").isdigit() and int(text) != 0
