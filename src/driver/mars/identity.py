"""What is on the other side of a link, learnt without touching it; and what it admits to hold."""

from __future__ import annotations

from collections.abc import Mapping

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, InputError
from driver.line.link import Link
from driver.line.manners import Manners, learn_manners
from driver.line.protocol import encode


def identify(link: Link, firmware: str) -> tuple[str, Manners]:
    """Learn by ECHO, STAMP and VER alone that a controller with this firmware answers: its full text, and its manners.

    Sets ``link.identified``, without which the link sends nothing else.

    Raises:
        InputError: nothing answers like a MARS, or the firmware is another's.
    """
    try:
        link.send("")  # ends whatever half line an earlier user left
        link.send(encode("ECHO", 0))
        link.synchronise(attempts=3)  # after power-up the unit sends noise that can spoil an answer
        version = link.ask("VER")
        manners = learn_manners(link)
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
    return version, manners


GRIPPER_AXES = ("G", "H")  # where the units' grippers hang


def gripper_answers(link: Link) -> dict[str, str | None]:
    """What the unit answers about the position of each axis that a gripper may hang on; None: nothing.

    In the emulator an axis without a gripper stands at 0, which no gripper's converter reads. Of real units that is
    assumed.
    """
    return {axis: link.ask_optional("AP", axis) for axis in GRIPPER_AXES}


def refuse_another(unit: Unit, answers: Mapping[str, str | None]) -> None:
    """Refuse a unit whose gripper is on another axis than it should be. Anything else proves nothing.

    Args:
        unit: that it should be.
        answers: of `gripper_answers`.

    Raises:
        InputError: the unit's own gripper axis has none, and another has.
    """
    own = unit.gripper.axis
    others = [axis for axis, text in answers.items() if axis != own and _has_gripper(text)]
    if others and not _has_gripper(answers.get(own)):
        said = {axis: "nothing" if text is None else f"AP{axis} = {text}" for axis, text in answers.items()}
        raise InputError(
            f"unit = {unit.name}: its gripper is on axis {own}, but here it is axis {others[0]} that has one "
            f"({', '.join(said.values())}): this is another arm, whose zeros and registers differ. Correct unit in the "
            "cell file; if it is right, the unit was used as another's: switch it off and on",
            unit=unit.name,
            answers=dict(answers),
        )


def _has_gripper(text: str | None) -> bool:
    return text is not None and text.strip().lstrip("-").isdigit() and int(text) != 0
