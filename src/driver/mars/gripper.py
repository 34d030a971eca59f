"""The gripper: an analog servo axis outside the coordinated group."""

from __future__ import annotations

from dataclasses import dataclass

from arm.controller.unit import GripperAxis
from driver.line.link import Link, NoAnswer
from driver.line.protocol import encode, parse_integer
from driver.mars.ready import wait_ready
from driver.mars.stopping import ask_again

GRIPPER_S = 10.0
SAMPLE_S = 0.2  # two readings this far apart,
REREAD_S = 0.02  # of jaws that are not told to move
STILL_ADC = 50  # and less than this apart mean rest (vendor's toolbox)
STALLED_FRACTION = 0.05  # of the stroke short of the target: something is between the jaws


@dataclass(frozen=True)
class GripperResult:
    """How a gripper move ended.

    Attributes:
        adc: where the jaws rest, ADC counts.
        fraction_closed: the same, 0 open to 1 closed.
        stalled: the jaws rest short of their target, so something is between them.
    """

    adc: int
    fraction_closed: float
    stalled: bool


def read_jaws(link: Link, gripper: GripperAxis) -> float:
    """Where the jaws are, 0 open to 1 closed, at rest: by two readings that agree, for one may be damaged.

    Raises:
        NoAnswer: they do not rest.
    """
    return gripper.fraction_closed(_rest(link, gripper.axis, REREAD_S))


def move_gripper(link: Link, gripper: GripperAxis, fraction_closed: float) -> GripperResult:
    """Move the jaws, 0 open to 1 closed, and wait until they rest, at the target or on an object.

    An object never lets the jaws reach their target, yet ``Rx!`` comes; so the position is read until it rests.

    Raises:
        ExecutionStopped: a fault, or not at rest in time.
    """
    axis, target = gripper.axis, gripper.adc(fraction_closed)
    link.send(encode("RELEASE", axis=axis))
    link.send(encode("G", target, axis=axis))
    wait_ready(link, "the jaws", GRIPPER_S, axis)
    adc = _rest(link, axis)
    return GripperResult(
        adc=adc,
        fraction_closed=gripper.fraction_closed(adc),
        stalled=abs(adc - target) > STALLED_FRACTION * abs(gripper.closed_adc - gripper.open_adc),
    )


def _rest(link: Link, axis: str, apart_s: float = SAMPLE_S) -> int:
    deadline = link.deadline(GRIPPER_S)
    last = ask_again(link, "AP", parse_integer, axis)
    while link.clock.now() < deadline:
        link.wait(apart_s)
        now = ask_again(link, "AP", parse_integer, axis)
        if abs(now - last) < STILL_ADC:
            return now
        last = now
    raise NoAnswer(f"the jaws are not at rest within {GRIPPER_S:g} s", adc=last, reason="deadline")
