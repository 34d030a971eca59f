"""The watch over the arm's place: what is on the path passes, what is off it twice in a row is told."""

from __future__ import annotations

import numpy as np
import pytest

from arm.errors import ExecutionStopped
from arm.motion import CountPath, Segment
from driver.pathwatch import LAG_SEGMENTS, PathWatch

ROW = (4800, -2400, 1200, 0, 0, 600)  # counts a segment
PATH = CountPath((0,) * 6, (Segment(100, (ROW, (0,) * 6, (0,) * 6)),) * 12)


def watch(tube: int | None = None, box: int = 1500) -> PathWatch:
    return PathWatch(PATH, "ABCDEF", box, tube)


def at(segments: float) -> tuple[int, ...]:
    return tuple(round(segments * c) for c in ROW)


def off(where: tuple[int, ...], axis: int, counts: int) -> tuple[int, ...]:
    return tuple(c + counts * (k == axis) for k, c in enumerate(where))


@pytest.mark.parametrize("tube", [None, 400])
@pytest.mark.parametrize("axis", range(6))
def test_two_samples_in_a_row_off_the_path_are_told_and_one_is_not(tube: int | None, axis: int) -> None:
    """One may have a digit lost on the line."""
    astray = off(at(5.5), axis, 30_000 if tube is None else 15_000)
    judged = watch(tube)
    for _ in range(3):
        judged.take(astray, 6, 8)
        judged.take(at(5.5), 6, 8)
    judged.take(astray, 6, 8)
    with pytest.raises(ExecutionStopped, match=r"axis [A-F] is .* counts off its path") as stopped:
        judged.take(astray, 6, 8)
    assert stopped.value.data["reason"] == "following"


def test_the_tube_is_as_narrow_as_its_points_are_dense() -> None:
    """A sound arm is nowhere further from one than half of a part of the segment, of which there are 24."""
    most = ROW[0] // 48
    for begun in range(1, 12):
        judged = watch(tube=most)
        for place in np.linspace(max(begun - 1 - LAG_SEGMENTS, 0), begun + 1, 97):
            for _ in range(2):
                judged.take(at(place), begun, 12)


@pytest.mark.parametrize(("place", "within"), [(1.5, False), (2.1, True), (7.0, True), (7.5, False)])
def test_the_tube_is_about_the_segments_that_may_run(place: float, within: bool) -> None:
    """From three before the running one, for the arm lags, to the one after it."""
    judged = watch(tube=400)
    judged.take(at(place), 6, 12)
    if within:
        judged.take(at(place), 6, 12)
        return
    with pytest.raises(ExecutionStopped):
        judged.take(at(place), 6, 12)


@pytest.mark.parametrize(("place", "within"), [(1.5, False), (2.0, True), (9.0, True), (9.5, False)])
def test_the_box_is_about_all_that_may_run_and_all_that_was_sent(place: float, within: bool) -> None:
    judged = watch(box=1500)
    judged.take(at(place), 6, 9)
    if within:
        judged.take(at(place), 6, 9)
        return
    with pytest.raises(ExecutionStopped):
        judged.take(at(place), 6, 9)
