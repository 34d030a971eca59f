"""At rest is what was seen to stand and to be idle: a row a rule, at the wire of a scripted unit in stepped time."""

from __future__ import annotations

from typing import Any

import pytest

from driver.line.link import ANSWER_S
from driver.line.protocol import Status
from driver.line.stepped_clock import SteppedClock
from driver.mars.mars import Mars
from driver.mars.stopping import SAMPLE_S, STOP_S, UNECHOED_LOOKS, RestState, bring_to_rest, read_status

BRAKES_S = 1.3  # the arm goes on for so long after STOP
AXES = tuple("ABCDEF")


def slides(fake: Any, counts_per_s: float, axis: int = 2) -> None:
    """From STOP on that axis moves for BRAKES_S, though nothing generates motion."""
    begun: list[float] = []

    def stop(line: str) -> None:
        begun.append(fake.clock.now())

    def at(line: str) -> None:
        if begun:
            passed = min(fake.clock.now() - begun[0], BRAKES_S)
            fake.offset[axis] = round(counts_per_s * passed)

    fake.hooks["STOP"], fake.hooks["COORDAP"] = stop, at


def stays_busy(fake: Any, bits: int = 0x10, for_s: float = BRAKES_S) -> None:
    """From STOP on the status has these bits for so long; the counts stand."""
    fake.hooks["STOP"] = lambda line: (
        setattr(fake, "status_bits", bits),
        fake.clock.call_after(for_s, lambda: setattr(fake, "status_bits", 0)),
        None,
    )[-1]


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("counts_per_s", [4000.0, -45.0])
def test_an_arm_whose_counts_change_is_not_at_rest(
    mars: Mars, fake: Any, clock: SteppedClock, axis: int, counts_per_s: float
) -> None:
    slides(fake, counts_per_s, axis)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= BRAKES_S
    assert state.counts == mars.counts()
    assert state.counts[axis] == fake.counts[axis] + round(counts_per_s * BRAKES_S)


def test_a_unit_that_is_busy_is_not_at_rest_though_its_counts_stand(
    mars: Mars, fake: Any, clock: SteppedClock
) -> None:
    stays_busy(fake)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= BRAKES_S
    assert state.status is not None
    assert not state.status.busy


@pytest.mark.parametrize("axes", [(), AXES])
def test_before_the_group_is_formed_the_status_tells(
    mars: Mars, fake: Any, clock: SteppedClock, axes: tuple[str, ...]
) -> None:
    stays_busy(fake)
    begin = clock.now()
    assert bring_to_rest(mars.link, axes).at_rest
    assert clock.now() - begin >= BRAKES_S


@pytest.mark.parametrize("what", ["counts", "busy"])
def test_what_never_ends_is_told_as_not_at_rest(
    mars: Mars, fake: Any, clock: SteppedClock, what: str
) -> None:
    if what == "busy":
        stays_busy(fake, for_s=1e6)
    else:
        fake.hooks["COORDAP"] = lambda line: fake.offset.__setitem__(0, fake.offset[0] + 50)
    begin = clock.now()
    state = mars.stop()
    assert not state.at_rest
    assert "still moving or busy 10 s after STOP" in state.note
    assert 10.0 <= clock.now() - begin < 11.0
    assert "MAY STILL BE MOVING" in state.describe(mars.unit)


@pytest.mark.parametrize("bits", [0x8, 0x10000, 0x20000])
def test_a_fault_holds_the_arm_whatever_the_unit_still_generates(
    mars: Mars, fake: Any, clock: SteppedClock, bits: int
) -> None:
    stays_busy(fake, bits | 0x10, 1e6)
    begin = clock.now()
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin < 1.0
    assert state.status is not None
    assert state.status.fault


def test_a_fault_does_not_make_moving_counts_stand(mars: Mars, fake: Any, clock: SteppedClock) -> None:
    slides(fake, 4000.0)
    fake.status_bits = 0x10000
    begin = clock.now()
    assert mars.stop().at_rest
    assert clock.now() - begin >= BRAKES_S


def test_standing_is_two_samples_apart_and_not_one(mars: Mars, clock: SteppedClock) -> None:
    begin = clock.now()
    assert mars.stop().at_rest
    assert clock.now() - begin >= 0.099


def test_a_damaged_sample_is_not_one_of_the_two(mars: Mars, fake: Any, clock: SteppedClock) -> None:
    """The arm moves between the two that are sound: what lies between is nothing to compare with."""
    asked: list[float] = []

    def damaged(line: str) -> list[str] | None:
        asked.append(fake.clock.now())
        if len(asked) == 2:
            fake.offset[0] += 500
        if len(asked) in (2, 3):
            return ["COORDAP=1,2,x"]
        return None

    fake.hooks["COORDAP"] = damaged
    state = mars.stop()
    assert state.at_rest
    assert state.counts is not None
    assert state.counts[0] == fake.counts[0] + 500
    assert len(asked) >= 3


def test_a_link_that_is_lost_leaves_the_state_unknown(mars: Mars, fake: Any) -> None:
    fake.hooks["STOP"] = lambda line: fake.unplug()
    state = mars.stop()
    assert not state.at_rest
    assert "the link is lost" in state.note


@pytest.mark.parametrize("lost_s", [0.5, 1.0])
def test_an_arm_that_stands_before_stop_has_come_back_is_not_at_rest_yet(
    mars: Mars, fake: Any, clock: SteppedClock, lost_s: float
) -> None:
    """A STOP that is lost on the line leaves what the unit still holds: it stands in a dwell, and goes on after it."""
    begin, write = clock.now(), fake.write
    fake.write = lambda data: write(data.replace(b"STOP:\n", b"") if clock.now() < begin + lost_s else data)
    state = mars.stop()
    assert state.at_rest
    assert clock.now() - begin >= lost_s


def test_an_arm_that_stands_for_many_looks_is_at_rest_though_no_stop_comes_back(
    mars: Mars, fake: Any, clock: SteppedClock
) -> None:
    write = fake.write
    fake.write = lambda data: write(data.replace(b"STOP:\n", b""))
    begin = clock.now()
    assert mars.stop().at_rest
    assert UNECHOED_LOOKS * SAMPLE_S <= clock.now() - begin < STOP_S


@pytest.mark.parametrize("axes", [("A",), AXES])
def test_a_group_that_is_gone_is_asked_for_axis_by_axis_however_many_there_are(
    mars: Mars, fake: Any, axes: tuple[str, ...]
) -> None:
    fake.hooks["COORDAP"] = lambda line: []
    fake.counts = [100 * (k + 1) for k in range(6)]
    state = bring_to_rest(mars.link, axes)
    assert state.at_rest
    assert state.counts == tuple(fake.counts[: len(axes)])


@pytest.mark.parametrize(
    ("word", "told"), [(None, "under power"), (0, "under power"), (0x20000, "motion stop is pressed")]
)
def test_a_fault_is_part_of_what_is_said_of_an_arm_at_rest(mars: Mars, word: int | None, told: str) -> None:
    status = None if word is None else Status(word)
    assert told in RestState(True, (0,) * 6, status).describe(mars.unit)


@pytest.mark.parametrize("hangs_s", [0.5, 1.9, 2.02, 2.5, 3.9])
def test_however_long_a_unit_hangs_the_answer_to_the_last_question_is_told(
    mars: Mars, fake: Any, clock: SteppedClock, hangs_s: float
) -> None:
    """It then answers all that it was asked, in order; the first answer must not pass for that to the second."""
    held: list[str] = []
    asked: list[str] = []
    until = clock.now() + hangs_s

    def when_awake(answer: str) -> list[str]:
        if clock.now() >= until:
            return [answer]
        held.append(answer)
        return []

    def status(line: str) -> list[str]:
        asked.append(line)
        return when_awake("ST=64" if len(asked) == 1 else "ST=32")

    fake.hooks["ST"] = status
    fake.hooks["STAMP"] = lambda line: when_awake(line.replace(":", "="))
    clock.call_after(hangs_s, lambda: [fake.write(f"{answer}\r\n".encode()) for answer in held])
    assert read_status(mars.link).word == (64 if hangs_s < ANSWER_S else 32)
    assert read_status(mars.link).word == 32


def test_axes_are_asked_one_by_one_only_where_the_group_does_not_answer(mars: Mars, fake: Any) -> None:
    fake.lines.clear()
    assert mars.stop().at_rest
    assert not any(line.startswith("AP") for line in fake.lines)


def test_a_stop_that_is_interrupted_again_does_not_say_that_the_arm_stands(
    mars: Mars, fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(mars.link, "receive", pressed)
    state = bring_to_rest(mars.link, AXES)
    assert not state.at_rest
    assert state.note == "interrupted again after STOP was sent"
    assert "STOP:" in fake.lines or state.stops > 0
