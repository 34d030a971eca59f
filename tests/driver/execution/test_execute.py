"""Steps of a plan on a scripted unit: order, starts, looks, and how a failure is told."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest

from arm.controller.segments import CountPath, Segment
from arm.controller.unit import Unit
from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.plan_file import GripperStep, LookStep, Move, Step
from driver.execution.control import Control
from driver.execution.execute import execute
from driver.execution.progress import Progress, StreamOptions
from driver.mars.mars import Mars
from wire.soft_home import SOFT_HOME

WATCHED = StreamOptions(watch_jaws=True)


def move(name: str, start: tuple[int, ...], step: tuple[int, ...]) -> Move:
    zero = (0,) * 6
    cubic = (zero, tuple(3 * c for c in step), tuple(-2 * c for c in step))
    path = CountPath(start, (Segment(100, cubic), Segment(100, cubic)))
    return Move(name, "transit", None, path, None, 0.05, 0.01, ("a", "b"))


def steps() -> list[Step]:
    first = move("out", SOFT_HOME, (100, 200, 300, 0, 0, 0))
    return [
        GripperStep("open", "open", None, 0.0, 0.5),
        first,
        GripperStep("close", "close", 0, 1.0, 0.5),
        move("back", first.path.end, (-100, -200, -300, 0, 0, 0)),
        LookStep("look"),
        move("again", SOFT_HOME, (1, 1, 1, 1, 1, 1)),
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
    assert mars.counts() == tuple(c + 2 for c in SOFT_HOME)


def test_looking_decides_whether_to_go_on(mars: Mars) -> None:
    looked: list[str] = []

    def look(step: LookStep) -> bool:
        looked.append(step.name)
        return False

    results = execute(mars, steps(), on_look=look)
    assert looked == ["look"]
    assert [r.step.name for r in results] == ["open", "out", "close", "back", "look"]
    assert mars.counts() == SOFT_HOME


def test_another_start_is_refused_with_the_difference(mars: Mars, fake: Any) -> None:
    fake.counts = [SOFT_HOME[0] + 1111, SOFT_HOME[1], SOFT_HOME[2] - 26, *SOFT_HOME[3:]]
    fake.lines.clear()
    with pytest.raises(
        ImpossibleError,
        match=r"A reads -180539, \+1111 \(\+1\.00 deg\), C reads -12226, -26 \(\+0\.02 deg\);",
    ) as refused:
        execute(mars, steps())
    assert refused.value.data["off_counts"] == [1111, 0, -26, 0, 0, 0]
    assert {line.rstrip("?") for line in fake.lines} == {"COORDAP"}


def test_an_arm_that_contact_holds_off_its_target_goes_on_from_there(mars: Mars, fake: Any) -> None:
    """As far as is allowed, and only where the unit's target is the start of the path."""
    fake.counts = [SOFT_HOME[0] + 40, *SOFT_HOME[1:]]
    with pytest.raises(ImpossibleError, match=r"\+40 .* must be within \d+ counts"):
        execute(mars, steps())
    with pytest.raises(ImpossibleError, match=r"\+40 "):
        execute(mars, steps(), options=StreamOptions(start_held_counts=10))
    fake.lines.clear()
    execute(mars, steps()[1:2], options=StreamOptions(start_held_counts=50, held_back_counts=50))
    assert any(line.startswith("COORDSPLINET") for line in fake.lines)
    end = mars.counts()
    fake.lines.clear()
    away = move("away", (end[0] + 40, *end[1:]), (1, 1, 1, 0, 0, 0)).path
    with pytest.raises(ImpossibleError, match="the path starts 40 counts from the arm, must be at most"):
        mars.follow(away, None, StreamOptions(start_held_counts=50), Control())
    assert not any(line.startswith("COORDSPLINET") for line in fake.lines)


def test_only_the_first_motion_may_begin_off_its_start(mars: Mars, fake: Any) -> None:
    """Later the arm has come away from what held it."""
    fake.counts = [SOFT_HOME[0] + 40, *SOFT_HOME[1:]]
    options = StreamOptions(start_held_counts=50, held_back_counts=50)
    with pytest.raises(
        ExecutionStopped, match=r"step 3 of 3 \(back\): .* 40 counts from where the last motion ended"
    ):
        execute(mars, steps()[1:4], options=options)


def test_a_failing_step_is_named_with_the_state(mars: Mars, fake: Any) -> None:
    fake.hooks["RG"] = lambda line: ["FAIL!"] if "GG:103" in fake.lines else None
    with pytest.raises(
        ExecutionStopped, match=r"step 3 of 6 \(close\): gripper: the jaws: the unit answered FAIL!"
    ) as stopped:
        execute(mars, steps())
    assert stopped.value.data["steps_done"] == 2
    assert stopped.value.data["state"]["at_rest"] is True
    assert len([line for line in fake.since("GG:103") if line.startswith("COORDSPLINET")]) == 0


def test_impossible_after_the_first_step_is_a_stop(mars: Mars) -> None:
    """Something has moved already, so it is no longer "nothing moved"."""
    first = move("out", SOFT_HOME, (100, 200, 300, 0, 0, 0))
    elsewhere = move("back", (0,) * 6, (1, 1, 1, 1, 1, 1))
    with pytest.raises(ExecutionStopped, match=r"step 3 of 3 \(back\): the path starts") as stopped:
        execute(mars, [first, LookStep("look"), elsewhere])
    assert stopped.value.data["steps_done"] == 2
    assert stopped.value.data["state"]["counts"] == list(first.path.end)


def test_impossible_at_the_first_step_moves_nothing(mars: Mars, fake: Any) -> None:
    far = move("far", SOFT_HOME, (0, 100_000, 0, 0, 0, 0))
    with pytest.raises(ImpossibleError, match="the path reaches"):
        execute(mars, [far])
    assert not any(line.startswith("COORDSPLINET") for line in fake.lines)


# -- moves that meet at speed are one motion


def line(name: str, start: tuple[int, ...], segments: int) -> Move:
    """At constant speed from its first count to its last."""
    path = CountPath(start, tuple(Segment(100, ((100, 20, -30, 5, 0, 0),)) for _ in range(segments)))
    return Move(name, "transit", 0, path, None, 0.05, 0.01, ("a", "b"))


def three(*segments: int) -> list[Step]:
    moves: list[Step] = []
    at = SOFT_HOME
    for name, count in zip(("lift", "across", "lower"), segments, strict=True):
        made = line(name, at, count)
        moves.append(made)
        at = made.path.end
    return moves


def test_moves_that_meet_go_as_one_stream_and_are_told_as_they_begin(mars: Mars, fake: Any) -> None:
    steps = [*three(8, 10, 12), GripperStep("close", "close", 0, 1.0, 0.2)]
    told: list[tuple[int, int]] = []  # step, segment that the unit runs
    seen: list[tuple[str, int, int]] = []
    names: list[str] = []
    before = [0]

    def begins(step: Step, index: int, total: int) -> None:
        names.append(step.name)
        before[0] = before[0] or fake.sequence
        told.append((index, fake.sequence - max(len(fake.queue) - 1, 0) - before[0] - 1))

    def look(progress: Progress) -> None:
        seen.append((names[-1], progress.done, progress.total))
        assert progress.planned_s == pytest.approx(0.1 * progress.done)

    results = execute(mars, steps, begins, look)
    assert [r.step for r in results] == steps
    assert names == [s.name for s in steps]
    assert [index for index, _ in told] == [0, 1, 2, 3]
    assert (
        9 <= told[1][1] <= 12
    )  # of the unit's own numbers: 1 to 8 are the first move's, the next poll is not far
    assert 19 <= told[2][1] <= 22
    assert {(name, total) for name, _, total in seen} == {("lift", 8), ("across", 10), ("lower", 12)}
    dwells = [x for x in fake.lines if x.startswith("COORDSPLINET") and set(x.split(",")[2:]) == {"0"}]
    assert (
        len([x for x in dwells if int(x.split(":")[1].split(",")[0]) >= 300]) == 1
    )  # others go before single moves
    sent = [r.sent for r in results[:3]]
    for part, step in zip(sent, steps, strict=False):
        assert part is not None
        assert isinstance(step, Move)
        assert part.path == step.path
        assert part.end_counts == step.path.end
        assert part.duration_s == pytest.approx(step.path.duration_s, abs=0.2)
    for first, second in pairwise(results):
        assert first.end_s == pytest.approx(second.start_s, abs=0.05)
        assert first.start_s < first.end_s


def test_moves_shorter_than_a_look_are_told_in_order(mars: Mars) -> None:
    told: list[str] = []
    results = execute(mars, three(1, 1, 1), lambda s, i, n: told.append(s.name))
    assert told == ["lift", "across", "lower"]
    assert [r.step.name for r in results] == told


def test_the_phase_that_ran_is_named(mars: Mars, fake: Any) -> None:
    def power(progress: Progress) -> None:
        if names[-1] == "across":
            fake.status_bits = 0x10000

    names: list[str] = []
    steps = three(8, 30, 8)
    with pytest.raises(
        ExecutionStopped, match=r"step 2 of 3 \(across\): stream: segment .* arm power"
    ) as stopped:
        execute(mars, steps, lambda s, i, n: names.append(s.name), power)
    assert stopped.value.data["step"] == "across"
    assert stopped.value.data["steps_done"] == 1
    assert stopped.value.data["state"]["at_rest"] is True


def test_moves_that_do_not_meet_move_nothing(mars: Mars, fake: Any) -> None:
    first, second, third = three(3, 3, 3)
    fake.lines.clear()
    with pytest.raises(InputError, match="path 1 of the chain starts at"):
        execute(mars, [first, third, second])
    assert fake.lines == []


def test_jaws_may_be_watched_on_the_way(mars: Mars, fake: Any, unit: Unit) -> None:
    fake.gripper_at = unit.gripper.adc(0.4)
    seen: list[float | None] = []
    execute(mars, three(5, 5, 5), on_progress=lambda p: seen.append(p.jaws))
    assert set(seen) == {None}
    execute(mars, [line("on", mars.counts(), 20)], None, lambda p: seen.append(p.jaws), None, WATCHED)
    assert [j for j in seen if j is not None] == pytest.approx(
        [0.4] * (len(seen) - seen.count(None)), abs=0.01
    )
    assert len([j for j in seen if j is not None]) > 10
