"""A MARS-8 as a controller of `driver.execution`: it has all that execution needs, and streams paths."""

from __future__ import annotations

from typing import Any

import pytest

from arm.errors import Aborted, InputError
from driver.execution.control import Control
from driver.execution.controller import Controller
from driver.execution.progress import Progress
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from wire.controlled_stream import run
from wire.soft_home import SOFT_HOME


def test_it_has_every_member_that_execution_needs(mars: Mars) -> None:
    needed = {name for name in vars(Controller) if not name.startswith("_")}
    assert len(needed) == 13
    assert [name for name in sorted(needed) if not hasattr(mars, name)] == []


def test_following_a_path_sends_its_segments_and_ends_where_it_ends(mars: Mars, fake: Any) -> None:
    mars.move_to(SOFT_HOME)
    path, seen = run(12), list[Progress]()
    arm: Controller = mars
    sent = arm.follow(path, seen.append, None, Control())
    assert sent.path == path
    assert arm.counts() == sent.end_counts == path.end
    assert len([line for line in fake.lines if line.startswith("COORDSPLINET:100,")]) == 12
    assert seen[-1].total == 12


def test_waiting_ends_when_woken_and_no_earlier_though_lines_come(mars: Mars, clock: SteppedClock) -> None:
    began = clock.now()
    mars.link.send("ST?")  # its answer comes meanwhile
    mars.wait_until(began + 0.5)
    assert clock.now() == pytest.approx(began + 0.5)
    clock.call_after(0.2, mars.wake)
    mars.wait_until(began + 9.0)
    assert clock.now() == pytest.approx(began + 0.7, abs=0.01)
    clock.call_after(0.2, mars.interrupt)
    with pytest.raises(Aborted):
        mars.wait_until(began + 9.0)
    assert clock.now() < began + 1.0


def test_nothing_is_read_of_a_unit_that_is_not_identified(fake: Any, unit: Any, clock: SteppedClock) -> None:
    with Mars(fake.line, unit, clock) as mars, pytest.raises(InputError, match="initialise"):
        mars.settled_counts()
    assert fake.lines == []
