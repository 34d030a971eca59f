"""Steps of a plan on a scripted unit: order, starts, looks, and how a failure is told."""

from __future__ import annotations

from typing import Any

import pytest

from arm.errors import ExecutionStopped, ImpossibleError
from arm.motion import CountPath, Segment
from arm.planfile import GripperStep, LookStep, Move, Step
from arm.unit import Unit
from driver.clock import Clock
from driver.execute import execute
from driver.mars import Mars

HOME = (-181650, -349, -12200, 99200, 33300, -96500)


@pytest.fixture
def mars(fake: Any, unit: Unit, clock: Clock) -> Any:
    fake.counts = list(HOME)
    with Mars(fake.url, unit, clock) as mars:
        mars.identify()
        mars.initialise(home=False)
        yield mars


def move(name: str, start: tuple[int, ...], step: tuple[int, ...]) -> Move:
    zero = (0,) * 6
    cubic = (zero, tuple(3 * c for c in step), tuple(-2 * c for c in step))
    path = CountPath(start, (Segment(100, cubic), Segment(100, cubic)))
    return Move(name, "transit", None, path, None, 0.05, 0.01, ("a", "b"))


def steps() -> list[Step]:
    first = move("out", HOME, (100, 200, 300, 0, 0, 0))
    return [
        GripperStep("open", "open", None, 0.0, 0.5),
        first,
        GripperStep("close", "close", 0, 1.0, 0.5),
        move("back", first.path.end, (-100, -200, -300, 0, 0, 0)),
        LookStep("look"),
        move("again", HOME, (1, 1, 1, 1, 1, 1)),
    ]


def test_steps_run_in_order_and_look_steps_are_passed_over(mars: Mars, fake: Any) -> None:
    fake.gripper_stop = 400
    told: list[tuple[str, int, int]] = []
    results = execute(mars, steps(), on_step=lambda s, i, n: told.append((s.name, i, n)))
    assert told == [(s.name, i, 6) for i, s in enumerate(steps())]
    assert [r.step for r in results] == steps()
    assert results[2].gripper is not None
    assert results[2].gripper.stalled
    assert results[1].sent is not None
    assert results[1].sent.path == steps()[1].path  # type: ignore[union-attr]
    assert results[2].end_s - results[2].start_s >= 0.5
    assert mars.counts() == tuple(c + 2 for c in HOME)


def test_looking_decides_whether_to_go_on(mars: Mars) -> None:
    looked: list[str] = []

    def look(step: LookStep) -> bool:
        looked.append(step.name)
        return False

    results = execute(mars, steps(), on_look=look)
    assert looked == ["look"]
    assert [r.step.name for r in results] == ["open", "out", "close", "back", "look"]
    assert mars.counts() == HOME


def test_another_start_is_refused_with_the_difference(mars: Mars, fake: Any) -> None:
    fake.counts = [HOME[0] + 1111, HOME[1], HOME[2] - 26, *HOME[3:]]
    fake.lines.clear()
    with pytest.raises(
        ImpossibleError, match=r"off by A \+1111 \(\+1\.00 deg\), C -26 \(\+0\.02 deg\);"
    ) as refused:
        execute(mars, steps())
    assert refused.value.data["off_counts"] == [1111, 0, -26, 0, 0, 0]
    assert {line.rstrip("?") for line in fake.lines} == {"COORDAP"}


def test_a_failing_step_is_named_with_the_state(mars: Mars, fake: Any) -> None:
    fake.hooks["RG"] = lambda line: ["FAIL!"] if "GG:103" in fake.lines else None
    with pytest.raises(
        ExecutionStopped, match="step 3 of 6, close: gripper: the jaws: the unit answered FAIL!"
    ) as stopped:
        execute(mars, steps())
    assert stopped.value.data["steps_done"] == 2
    assert stopped.value.data["state"]["at_rest"] is True
    assert len([line for line in fake.since("GG:103") if line.startswith("COORDSPLINET")]) == 0


def test_impossible_after_the_first_step_is_a_stop(mars: Mars) -> None:
    """Something has moved already, so it is no longer "nothing moved"."""
    first = move("out", HOME, (100, 200, 300, 0, 0, 0))
    elsewhere = move("back", (0,) * 6, (1, 1, 1, 1, 1, 1))
    with pytest.raises(ExecutionStopped, match="step 2 of 2, back: the path starts") as stopped:
        execute(mars, [first, elsewhere])
    assert stopped.value.data["steps_done"] == 1
    assert stopped.value.data["state"]["counts"] == list(first.path.end)


def test_impossible_at_the_first_step_moves_nothing(mars: Mars, fake: Any) -> None:
    far = move("far", HOME, (0, 100_000, 0, 0, 0, 0))
    with pytest.raises(ImpossibleError, match="the path reaches"):
        execute(mars, [far])
    assert not any(line.startswith("COORDSPLINET") for line in fake.lines)
