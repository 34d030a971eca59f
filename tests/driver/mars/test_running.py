"""Which segment the unit executes, by numbers that may be damaged; and what its parameter counts to."""

from __future__ import annotations

import pytest

from driver.line.protocol import Position
from driver.mars.lookahead import Timeline
from driver.mars.running import ParameterScale, Running

AT = (0,) * 6


@pytest.fixture
def timeline() -> Timeline:
    found = Timeline([0.1] * 40)
    found.stands(0, 10.0)
    return found


def test_segments_are_counted_from_the_dwell_on_also_where_the_units_numbers_wrap(timeline: Timeline) -> None:
    running = Running()
    assert not running.take(7, 40, timeline, 10.0)
    assert running.stands(0x7FFE, 0)
    assert running.known
    assert running.take(0x7FFF, 40, timeline, 10.05)
    assert running.take(1, 40, timeline, 10.35)
    assert running.counted == 3


def test_a_number_that_the_unit_cannot_have_reached_is_not_believed(timeline: Timeline) -> None:
    running = Running()
    running.stands(100, 0)
    assert running.take(105, 40, timeline, 10.45)
    assert not running.take(115, 40, timeline, 10.55)  # a digit changed: too early by 1 s
    assert running.take(106, 40, timeline, 10.65)
    assert not running.take(16, 40, timeline, 10.75)  # cut: back
    assert not running.take(109, 8, timeline, 19.0)  # more than were sent
    assert not running.known  # and twice in a row: what it was counted from may be wrong


def test_of_two_numbers_of_a_dwell_the_one_told_twice_counts(timeline: Timeline) -> None:
    running = Running()
    assert running.stands(900, 3)  # damaged
    assert not running.stands(100, 3)
    assert running.stands(100, 3)
    assert running.take(102, 40, timeline, 10.5)
    assert running.counted == 5


def sample(ms: int, parameter: int, number: int = 5) -> Position:
    return Position(ms, number, parameter, AT)


def test_the_parameters_scale_is_learnt_from_a_dwell_across_the_clocks_wrap() -> None:
    scale = ParameterScale()
    scale.begin()
    for ms, parameter in ((65500, 100), (64, 2100), (165, 4120)):
        assert scale.to_learn
        scale.stands(sample(ms, parameter), 500)
    assert scale.full == pytest.approx(10_000, rel=0.01)
    assert scale.share(sample(0, 2500)) == pytest.approx(0.25, rel=0.02)
    assert scale.share(sample(0, 10_200)) == 1.0
    assert scale.share(sample(0, 30_000)) is None  # damaged
    assert scale.share(sample(0, -5)) is None


@pytest.mark.parametrize(
    "samples",
    [
        ((100, 1000), (200, 3000), (300, 9000)),  # a digit changed
        ((100, 0), (200, 0), (300, 0)),  # a unit that does not tell
        ((100, 1000), (110, 1200), (120, 1400)),  # too near each other
    ],
)
def test_no_scale_is_learnt_from_samples_that_do_not_agree(samples: tuple[tuple[int, int], ...]) -> None:
    scale = ParameterScale()
    scale.begin()
    for ms, parameter in samples:
        scale.stands(sample(ms, parameter), 500)
    assert scale.full is None
    assert scale.share(sample(0, 100)) is None
    for _ in range(3):
        scale.begin()
    assert not scale.to_learn  # long dwells cost time: no further attempts


def test_the_scale_is_that_of_the_whole_time_that_was_seen() -> None:
    """The two halves of it may differ by what a sample comes late."""
    scale = ParameterScale()
    scale.begin()
    for ms, parameter in ((0, 0), (100, 2040), (200, 4000)):
        scale.stands(sample(ms, parameter), 500)
    assert scale.full == pytest.approx(4000 / 200 * 500)
