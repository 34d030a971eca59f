"""Whether the arm is where its path is, where no echo tells what the unit received."""

from __future__ import annotations

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment
from arm.errors import ExecutionStopped
from arms.count_paths import quintic
from driver.mars.streaming.path_watch import ASTRAY, PathWatch, _widened

AXES = "ABCDEF"
SEGMENTS = 30
PATH = quintic((0, 0, 0, 0, 0, 0), SEGMENTS)
TUBE = 100


def watch(path: CountPath = PATH) -> PathWatch:
    return PathWatch(path, AXES, 1500, TUBE)


def followed(
    watched: PathWatch, executed: CountPath, lag_s: float, first: int = 1, last: int = SEGMENTS
) -> None:
    """Samples of an arm that executes that path, `lag_s` late, three a segment, by the unit's own numbers."""
    for begun in range(first, last + 1):
        for share in (0.1, 0.4, 0.7):
            at = executed.at([0.1 * (begun - 1 + share) - lag_s])[0]
            watched.take(tuple(int(c) for c in np.rint(at)), begun, SEGMENTS, share)


def stands_at(
    watched: PathWatch, counts: tuple[int, ...], begun: int, share: float | None, sure: bool = True
) -> None:
    """So many samples as tell that the arm is off its path."""
    for _ in range(ASTRAY):
        watched.take(counts, begun, SEGMENTS, share, sure)


@pytest.mark.parametrize("lag_s", [0.0, 0.03, 0.12])
def test_an_arm_that_follows_evenly_however_late_is_on_its_path(lag_s: float) -> None:
    followed(watch(), PATH, lag_s)


@pytest.mark.parametrize("share", [None, 1.0])
@pytest.mark.parametrize("ends", [10, SEGMENTS])
def test_an_arm_that_has_caught_up_where_it_stands_is_on_its_path(share: float | None, ends: int) -> None:
    """It followed late; the segment has been over for longer than that, and no other was sent."""
    watched = watch()
    followed(watched, PATH, 0.06, last=ends)
    stands_at(watched, tuple(int(c) for c in PATH.knots()[ends]), ends, share)
    if ends == SEGMENTS:
        stands_at(watched, PATH.end, ends + 1, share)
    beyond = tuple(int(c) for c in PATH.knots()[ends] + 2 * TUBE)
    with pytest.raises(ExecutionStopped, match="off its path"):
        stands_at(watched, beyond, ends, share)


@pytest.mark.parametrize("lag_s", [0.0, 0.03, 0.06])
@pytest.mark.parametrize("damage", ["lost", "doubled", "changed"])
def test_one_damaged_segment_shows_before_the_motion_ends(damage: str, lag_s: float) -> None:
    at = 8
    segments = list(PATH.segments)
    if damage == "lost":
        del segments[at]
    elif damage == "doubled":
        segments.insert(at, segments[at])
    else:
        rows = [list(row) for row in segments[at].coefficients]
        rows[0][2] += 500
        segments[at] = Segment(segments[at].duration_ms, tuple(tuple(row) for row in rows))
    executed = CountPath(PATH.start, tuple(segments))
    watched = watch()
    with pytest.raises(ExecutionStopped, match="off its path") as stopped:
        followed(watched, executed, lag_s, last=SEGMENTS - 6)
    assert stopped.value.data["reason"] == "following"


def test_a_lag_that_jumps_is_an_arm_off_its_path() -> None:
    watched = watch()
    followed(watched, PATH, 0.02, last=12)
    with pytest.raises(ExecutionStopped):
        followed(watched, PATH, 0.09, first=13, last=18)


def test_without_the_place_in_the_segment_all_of_it_is_allowed() -> None:
    watched = watch()
    within, beyond = (tuple(int(c) for c in PATH.at([t])[0]) for t in (1.5, 1.62))
    stands_at(watched, within, 15, None)
    with pytest.raises(ExecutionStopped):
        stands_at(watched, beyond, 15, None)


def test_one_damaged_sample_is_doubted_and_stops_nothing() -> None:
    watched = watch()
    assert not watched.doubtful
    watched.take((9000,) * 6, 3, SEGMENTS, 0.5)
    assert watched.doubtful
    followed(watched, PATH, 0.0, first=3)
    assert not watched.doubtful


def test_where_the_segment_is_not_known_only_the_box_counts() -> None:
    watched = watch()
    stands_at(watched, tuple(int(c) for c in PATH.at([1.9])[0]), 3, 0.5, sure=False)
    with pytest.raises(ExecutionStopped, match="at most 1500"):
        stands_at(watched, (-9000,) * 6, 3, 0.5, sure=False)


def test_in_the_dwell_and_behind_the_end_the_arm_stands_at_the_paths_ends() -> None:
    watched = watch()
    stands_at(watched, PATH.start, 0, 1.0)
    stands_at(watched, PATH.end, SEGMENTS + 1, 0.0)
    with pytest.raises(ExecutionStopped):
        stands_at(watched, PATH.end, 0, 1.0)
    with pytest.raises(ExecutionStopped):
        stands_at(watched, PATH.start, SEGMENTS + 1, 0.0)


ROW = (4800, -2400, 1200, 0, 0, 600)  # counts a segment
STRAIGHT = CountPath((0,) * 6, (Segment(100, (ROW, (0,) * 6, (0,) * 6)),) * 12)


def on_straight(segments: float) -> tuple[int, ...]:
    return tuple(round(segments * c) for c in ROW)


@pytest.mark.parametrize("tube", [None, TUBE])
@pytest.mark.parametrize("axis", range(6))
def test_two_samples_in_a_row_off_the_path_are_told_and_one_is_not(tube: int | None, axis: int) -> None:
    """One may have a digit lost on the line."""
    right = on_straight(5.5)
    astray = tuple(c + 30_000 * (k == axis) for k, c in enumerate(right))
    judged = PathWatch(STRAIGHT, AXES, 1500, tube)
    for _ in range(3):
        judged.take(astray, 6, 8)
        judged.take(right, 6, 8)
    judged.take(astray, 6, 8)
    with pytest.raises(ExecutionStopped, match=r"axis [A-F] is .* counts off its path") as stopped:
        judged.take(astray, 6, 8)
    assert stopped.value.data["reason"] == "following"


@pytest.mark.parametrize(("place", "within"), [(1.5, False), (2.0, True), (9.0, True), (9.5, False)])
def test_the_box_is_about_all_that_may_run_and_all_that_was_sent(place: float, within: bool) -> None:
    judged = PathWatch(STRAIGHT, AXES, 1500, None)
    judged.take(on_straight(place), 6, 9)
    if within:
        judged.take(on_straight(place), 6, 9)
        return
    with pytest.raises(ExecutionStopped):
        judged.take(on_straight(place), 6, 9)


def test_an_arm_anywhere_between_two_lags_that_are_looked_at_is_on_its_path() -> None:
    """However fast it is: at 20,000 counts a segment a step of the lag is 1000 counts long."""
    row = (20_000, -20_000, 7_000, 0, 100, -300)
    fast = CountPath((0,) * 6, (Segment(100, (row, (0,) * 6, (0,) * 6)),) * SEGMENTS)
    watched = PathWatch(fast, AXES, 1500, 2)
    for lag_s in np.arange(0.0, 0.014, 0.0013):
        followed(watched, fast, float(lag_s), 5, 6)


def test_what_is_widened_holds_so_many_rows_to_either_side() -> None:
    near = np.zeros((9, 2), dtype=bool)
    near[[4, 0], [0, 1]] = True
    assert np.flatnonzero(_widened(near, 2)[:, 0]).tolist() == [2, 3, 4, 5, 6]
    assert np.flatnonzero(_widened(near, 2)[:, 1]).tolist() == [0, 1, 2]
    assert (_widened(near, 1) >= near).all()
