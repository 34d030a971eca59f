"""Single moves and the gripper against a scripted unit: what is sent, in which order, and what is not believed."""

from __future__ import annotations

from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError
from driver.line.clock import Clock
from driver.mars.mars import Mars
from driver.mars.start.startup import slow_registers
from wire.soft_home import SOFT_HOME


def test_move_to_goes_where_it_is_told(mars: Mars, fake: Any) -> None:
    target = [c + 1000 for c in SOFT_HOME]
    assert list(mars.move_to(target)) == target
    assert mars.reference == tuple(target)


def test_a_target_outside_the_limits_moves_nothing(mars: Mars, fake: Any, unit: Unit) -> None:
    before = len(fake.lines)
    with pytest.raises(ImpossibleError, match=r"target 90\..* deg on axis B: must be from"):
        mars.move_to([SOFT_HOME[0], 100_000, *SOFT_HOME[2:]])
    assert len(fake.lines) == before


def test_an_old_ready_is_not_believed(mars: Mars, fake: Any, clock: Clock) -> None:
    """R! comes at once, left over from an abandoned wait; the arm only starts later, but the status says busy."""
    target = tuple(c + 1000 for c in SOFT_HOME)
    asked = []

    def late(line: str) -> list[str] | None:
        asked.append(line)
        if len(asked) < 5:
            return ["ST=16"]
        fake.counts = list(target)
        return None

    def start(line: str) -> list[str]:
        fake.hooks["ST"] = late
        return []

    fake.hooks["COORDMV"] = start
    fake.hooks["R"] = lambda line: ["R!"]
    assert mars.move_to(target) == target


def test_a_static_error_of_the_arm_is_accepted_up_to_25_counts(mars: Mars, fake: Any) -> None:
    fake.offset = [25, -19, 3, 1, 2, 0]
    target = [c + 500 for c in SOFT_HOME]
    assert mars.move_to(target)[0] == target[0] + 25
    fake.offset = [27, 0, 0, 0, 0, 0]
    with pytest.raises(ExecutionStopped, match="counts from") as stopped:
        mars.move_to(SOFT_HOME)
    assert stopped.value.data["reason"] == "displaced"


def test_an_arm_that_was_pushed_is_not_moved(mars: Mars, fake: Any) -> None:
    fake.counts[0] += 4000
    fake.lines.clear()
    with pytest.raises(ExecutionStopped, match="4000 counts from where the last motion ended") as stopped:
        mars.move_to(SOFT_HOME)
    assert stopped.value.data["state"]["counts"][0] == SOFT_HOME[0] + 4000
    assert not [
        line for line in fake.lines if line.startswith("COORD") and line.endswith(tuple("0123456789"))
    ]


def test_an_arm_that_does_not_settle_is_stopped(mars: Mars, fake: Any) -> None:
    def drift(line: str) -> None:
        fake.offset[0] += 4

    fake.hooks["COORDAP"] = drift
    with pytest.raises(ExecutionStopped, match="does not settle") as stopped:
        mars.settled_counts()
    assert stopped.value.data["reason"] == "settle"


def test_after_a_stop_the_generator_is_anchored_slowly(mars: Mars, fake: Any, unit: Unit) -> None:
    fake.lines.clear()
    mars.stop()
    assert mars.reference is None
    mars.anchor(SOFT_HOME)
    mars.link.synchronise()
    since = fake.since("STOP:")
    moves = [i for i, line in enumerate(since) if line.startswith("COORDMV")]
    assert len(moves) == 1
    slow = since.index(f"REGMSA:{slow_registers(unit)[0]}")
    assert slow < moves[0]
    assert since.index("REGMSA:7680") > moves[0]
    assert mars.reference == SOFT_HOME
    with pytest.raises(ImpossibleError, match="26 counts"):
        mars.anchor([SOFT_HOME[0] + 26, *SOFT_HOME[1:]])


def test_the_shoulder_is_engaged_again_after_idling(mars: Mars, fake: Any, monkeypatch: Any) -> None:
    mars._last_motion -= 1150.0
    mars.move_to(SOFT_HOME)
    assert fake.lines.count("SPDTB:0,300") == 2


def test_registers_change_and_motions_begin_only_while_nothing_moves(mars: Mars, fake: Any) -> None:
    fake.append(60.0, [1000] * 6)
    fake.lines.clear()
    with pytest.raises(ExecutionStopped, match="registers can change only while the arm is at rest"):
        mars.set_registers(mars.speed_registers, mars.acceleration_registers)
    with pytest.raises(ExecutionStopped, match="the arm cannot move: it is still moving"):
        mars.require_ready()
    assert not any(line.startswith(("REG", "COORDMV", "SPDT")) for line in fake.lines)


@pytest.mark.parametrize("told", [False, True])
def test_an_error_that_leaves_the_arm_has_the_state_it_was_left_in(
    fake: Any, unit: Unit, clock: Clock, told: bool
) -> None:
    """One that has it already was raised behind a stop: no other is sent."""
    error = ExecutionStopped("mine", **({"state": {"at_rest": True}} if told else {}))

    def use() -> None:
        with Mars(fake.line, unit, clock) as mars:
            mars.identify()
            mars.initialise()
            fake.lines.clear()
            raise error

    with pytest.raises(ExecutionStopped, match="mine"):
        use()
    assert error.data["state"]["at_rest"]
    assert ("STOP:" in fake.lines) is not told
