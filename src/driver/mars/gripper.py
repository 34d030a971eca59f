"""The gripper: an analog servo axis outside the coordinated group."""

from __future__ import annotations

from dataclasses import dataclass

from arm.controller.unit import GripperAxis
from driver.line.link import Link, NoAnswer
from driver.line.protocol import encode, parse_integer
from driver.mars.ready import wait_ready
from driver.mars.stopping import ask_again

GRIPPER_S = 10.0  # time limit of a gripper move
SAMPLE_S = 0.2  # between two readings during a gripper move
REREAD_S = 0.02  # between two readings when no move was commanded
STILL_ADC = 50  # ADC counts: two readings that differ by less mean rest (vendor's toolbox)
STALLED_FRACTION = 0.05  # of the stroke: jaws at rest further than this from their target hold an object


@dataclass(frozen=True)
class GripperResult:
    """How a gripper move ended.

    Attributes:
        adc: jaw position at rest, ADC counts.
        fraction_closed: the same position, 0 open to 1 closed.
        stalled: the jaws rest short of their target, so something is between them.
    """

    adc: int
    fraction_closed: float
    stalled: bool


def read_jaws(link: Link, gripper: GripperAxis) -> float:
    """Return the position of resting jaws, 0 open to 1 closed. Two readings must agree, as one may be damaged.

    Raises:
        NoAnswer: the jaws do not come to rest.
    """
    return gripper.fraction_closed(_rest(link, gripper.axis, REREAD_S))


def move_gripper(link: Link, gripper: GripperAxis, fraction_closed: float) -> GripperResult:
    """Move the jaws, 0 open to 1 closed, and wait until they rest, at the target or on an object.

    ``Rx!`` comes even if an object blocks the jaws, so their position is read until it no longer changes.

    Raises:
        ExecutionStopped: a fault, or the jaws do not come to rest in time.
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
