"""The gripper at the wire of a scripted unit: an object, none, a failure, no rest."""

from __future__ import annotations

from typing import Any

import pytest

from arm.errors import ExecutionStopped, InputError
from driver.mars.mars import Mars


def test_gripper_tells_an_object_from_none(mars: Mars, fake: Any) -> None:
    shut = mars.gripper(1.0)
    assert (shut.adc, shut.stalled) == (103, False)
    mars.gripper(0.0)
    fake.gripper_stop = 420
    held = mars.gripper(1.0)
    assert (held.adc, held.stalled) == (420, True)
    assert held.fraction_closed == pytest.approx((840 - 420) / 737)
    assert fake.lines[fake.lines.index("GG:103") - 1] == "RELEASEG:"
    with pytest.raises(InputError, match="must be from 0 to 1"):
        mars.gripper(1.01)


@pytest.mark.parametrize(("short", "stalled"), [(0, False), (36, False), (37, True), (300, True)])
def test_jaws_that_rest_a_twentieth_of_their_stroke_short_hold_something(
    mars: Mars, fake: Any, short: int, stalled: bool
) -> None:
    gripper = mars.unit.gripper
    assert 36 < abs(gripper.open_adc - gripper.closed_adc) / 20 < 37
    fake.gripper_stop = gripper.closed_adc + short
    assert mars.gripper(1.0).stalled is stalled


def test_gripper_failure_stops(mars: Mars, fake: Any) -> None:
    fake.hooks["RG"] = lambda line: ["FAIL!"]
    with pytest.raises(ExecutionStopped, match="gripper: the jaws: the unit answered FAIL!"):
        mars.gripper(1.0)
    assert "STOP:" in fake.since("RG:")


def test_jaws_that_never_rest_end_by_the_deadline(mars: Mars, fake: Any) -> None:
    fake.hooks["APG"] = lambda line: [f"APG={int(mars.clock.now() * 1000) % 700}"]
    with pytest.raises(ExecutionStopped, match="the jaws are not at rest within 10 s"):
        mars.gripper(1.0)
