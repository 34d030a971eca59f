"""One damaged answer anywhere in a session stops nothing: what was asked is asked again."""

from __future__ import annotations

import random
import re

import numpy as np
import pytest

from arm.controller.unit import Unit, load_unit
from arms.count_paths import quintic
from driver.emulator import Emulator, EmulatorOptions
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.streaming.stream import stream
from wire.fault_matrix import Object

ANSWER = re.compile(rb"(COORDAP|ST|STAMP|AP[A-H])=")
ANSWERS = 112  # of a session, about


class OneDamaged:
    """A tap to the host: the nth answer has a digit changed, a character lost, or is lost."""

    def __init__(self, nth: int, seed: int) -> None:
        self.left, self.rng, self.answers = nth, random.Random(seed), 0

    def __call__(self, now_s: float, data: bytes) -> bytes:
        if not ANSWER.match(data):
            return data
        self.answers += 1
        if self.answers != self.left:
            return data
        kind = self.rng.randrange(3)
        if kind == 0:
            return b""
        text = data.rstrip()
        digits = [i for i in range(len(text)) if text[i : i + 1].isdigit()]
        at = self.rng.choice(digits)
        new = (
            b""
            if kind == 1
            else self.rng.choice([b"%d" % d for d in range(10) if b"%d" % d != text[at : at + 1]])
        )
        return text[:at] + new + text[at + 1 :] + b"\r\n"


def session(unit: Unit, nth: int, seed: int) -> int:
    """Home, move, grip, stream; how many answers there were. What is raised is a false stop."""
    clock, tap = SteppedClock(), OneDamaged(nth, seed)
    near = tuple(float(d) for d in np.degrees(unit.positions(np.ones(6))) + 0.3)
    options = EmulatorOptions(power_up_deg=near)
    with (
        Emulator(unit, clock, plant=Object(), options=options) as emulator,
        Mars(emulator.open_line(0.01, None, tap), unit, clock) as mars,
    ):
        mars.identify()
        mars.initialise(soft_home=False)
        mars.move_to((-3000, 200, 900, 900, 800, -900))
        assert mars.gripper(1.0).stalled
        assert 0.4 < mars.jaws() < 0.6
        path = quintic((-3000, 200, 900, 900, 800, -900), 8, (-2000, 100, 500, 500, 500, -500))
        assert stream(mars, path).end_counts == path.end == emulator.counts()
    return tap.answers


def test_a_session_has_about_so_many_answers() -> None:
    assert abs(session(load_unit("crs93"), 0, 0) - ANSWERS) < 30


@pytest.mark.few(10)
@pytest.mark.parametrize("nth", range(1, ANSWERS - 6, 3))
def test_one_damaged_answer_stops_no_session(unit: Unit, nth: int) -> None:
    session(unit, nth, seed=5 * nth + 1)
