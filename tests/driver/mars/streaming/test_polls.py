"""What the statuses of a running stream mean together."""

from __future__ import annotations

from driver.line.protocol import Status
from driver.mars.streaming.polls import Poll, Polls

BUSY, IDLE, FAULT = Status(0x10), Status(0), Status(0x18)


def asked(*statuses: Status) -> Polls:
    looks = Polls()
    for number, _ in enumerate(statuses):
        looks.ask(Poll(number, 1, float(number)))
    return looks


def test_a_unit_is_idle_when_it_says_so_twice() -> None:
    looks = asked(*[BUSY] * 5)
    looks.take(IDLE)
    assert not looks.idle
    looks.take(BUSY)
    looks.take(IDLE)
    assert not looks.idle
    looks.take(IDLE)
    assert looks.idle
    looks.begin()
    assert looks.oldest is None
    assert not looks.idle
    looks.take(IDLE)
    assert not looks.idle  # what it said before it was told to stand does not count


def test_a_fault_is_believed_when_it_is_told_twice_and_asked_about_at_once() -> None:
    looks = asked(*[BUSY] * 4)
    assert looks.take(FAULT)[1] == Status(0)
    assert looks.doubtful
    assert looks.take(BUSY)[1] == BUSY
    assert not looks.doubtful
    looks.take(FAULT)
    assert looks.take(FAULT)[1] == FAULT
    assert looks.oldest is None
    looks.take(FAULT)
    assert looks.next_at(0.2, 0.5, at_once=False) == looks.asked_at


def test_the_next_look_comes_after_the_answer_or_when_that_is_lost() -> None:
    looks = Polls()
    assert looks.next_at(0.2, 0.5, at_once=False) < 0.0
    looks.ask(Poll(3, 1, 7.0))
    assert looks.oldest == Poll(3, 1, 7.0)
    assert looks.next_at(0.2, 0.5, at_once=True) == 7.5
    assert looks.take(BUSY)[0] == Poll(3, 1, 7.0)
    assert looks.next_at(0.2, 0.5, at_once=False) == 7.2
    assert looks.next_at(0.2, 0.5, at_once=True) == 7.0


def test_a_status_that_nobody_asked_for_belongs_to_no_look() -> None:
    assert Polls().take(BUSY) == (Poll(0, 0, 0.0), BUSY)
