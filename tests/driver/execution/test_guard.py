"""Whatever ends a session or a guarded block, the arm is stopped once, and only if it is known what it is."""

from __future__ import annotations

from typing import NoReturn

import pytest

from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError, NoAnswer
from driver.execution.guard import Guarded
from driver.execution.rest import SAMPLE_S, SETTLE_S, RestState
from driver.line.stepped_clock import SteppedClock


class Arm(Guarded):
    identified = True
    places: list[tuple[int, ...]] = []  # noqa: RUF012
    stops = closed = 0

    def counts(self) -> tuple[int, ...]:
        return self.places.pop(0) if self.places else (0,) * 6

    def wait_until(self, until: float) -> None:
        """Woken all the time."""
        self.clock.sleep(min(0.03, until - self.clock.now()))

    def stop(self) -> RestState:
        self.stops += 1
        return RestState(True, (0,) * 6, stops=self.stops)

    def close(self) -> None:
        self.closed += 1


def fail(error: BaseException) -> NoReturn:
    raise error


@pytest.fixture
def arm(unit: Unit) -> Arm:
    return Arm(unit, SteppedClock())


def test_a_block_that_ends_well_stops_nothing(arm: Arm) -> None:
    with arm, arm.guarded("a"):
        pass
    assert (arm.stops, arm.closed) == (0, 1)


@pytest.mark.parametrize(
    "error", [NoAnswer("late", reason="silent"), KeyboardInterrupt(), ValueError(), InputError("wrong")]
)
def test_any_error_inside_stops_once_though_blocks_are_nested(arm: Arm, error: BaseException) -> None:
    with pytest.raises(BaseException) as raised, arm, arm.guarded("outer"), arm.guarded("inner"):  # noqa: PT011
        fail(error)
    assert arm.closed == 1
    if isinstance(error, NoAnswer | KeyboardInterrupt):
        assert isinstance(raised.value, ExecutionStopped)
        assert raised.value.data["state"]["at_rest"] is True
        assert raised.value.data["reason"] == ("silent" if isinstance(error, NoAnswer) else "interrupted")
        assert str(raised.value).startswith("outer")
        assert arm.stops == 1
    else:
        assert raised.value is error
        assert arm.stops == (
            2 if isinstance(error, ValueError) else 1
        )  # the session does not know that it stands


@pytest.mark.parametrize(
    ("error", "stops"),
    [
        (ExecutionStopped("x"), 1),
        (ExecutionStopped("x", state={}), 0),
        (ImpossibleError("x"), 0),
        (ValueError(), 1),
    ],
)
def test_leaving_a_session_by_an_error_stops_unless_nothing_moves(
    arm: Arm, error: Exception, stops: int
) -> None:
    with pytest.raises(type(error)), arm:
        fail(error)
    assert (arm.stops, arm.closed) == (stops, 1)


def test_an_arm_that_is_not_identified_is_told_nothing(arm: Arm) -> None:
    arm.identified = False
    with pytest.raises(ValueError), arm:  # noqa: PT011
        fail(ValueError())
    assert (arm.stops, arm.closed) == (0, 1)


def test_an_arm_has_settled_when_two_samples_agree_that_are_far_enough_apart(arm: Arm) -> None:
    arm.places = [(90 - k,) * 6 for k in range(0, 30, 3)] + [(61,) * 6]
    assert arm.settled_counts() == (61,) * 6
    assert arm.clock.now() == pytest.approx(10 * SAMPLE_S)


def test_an_arm_that_never_settles_is_given_up(arm: Arm) -> None:
    arm.places = [(3 * k,) * 6 for k in range(1000)]
    with pytest.raises(NoAnswer, match="does not settle") as late:
        arm.settled_counts()
    assert late.value.data["reason"] == "settle"
    assert arm.clock.now() == pytest.approx(max(SETTLE_S, arm.clock.patience(SETTLE_S)), abs=SAMPLE_S)
