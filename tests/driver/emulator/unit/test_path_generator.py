"""The path generator alone: the vertex rule, the path, its limits, and stops on it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from driver.emulator.unit.path_generator import PathGenerator
from emulated.queued_segments import ACCELERATION, SPEED, add, run


def lines(deltas: npt.NDArray[np.int64]) -> list[list[list[int]]]:
    return [[[int(v)] for v in delta] for delta in deltas]


def cubics(n: int, distance: npt.NDArray[np.float64]) -> list[list[list[int]]]:
    """A quintic from rest to rest cut into n cubic Hermite pieces of integer coefficients."""
    x = np.linspace(0.0, 1.0, n + 1)[:, None]
    knots = np.rint((x**3 * (10 + x * (-15 + 6 * x))) * distance).astype(int)
    slopes = 30 * x**2 * (1 - x) ** 2 * distance / n
    pieces = []
    for i in range(n):
        d = knots[i + 1] - knots[i]
        a1, a3 = np.rint(slopes[i]).astype(int), np.rint(slopes[i] + slopes[i + 1] - 2 * d).astype(int)
        pieces.append(np.stack([a1, d - a1 - a3, a3], axis=1).tolist())
    return pieces


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("steps", [0, 5])
def test_random_lines_stay_inside_speed_and_vertex_rule(seed: int, steps: int) -> None:
    rng = np.random.default_rng(seed)
    deltas = rng.integers(-4000, 4001, (12, 6))
    path = PathGenerator((0,) * 6)
    for row in lines(deltas):
        add(path, row, steps=steps)
    at = run(path)
    velocity = np.diff(at, axis=0)
    assert np.array_equal(at[-1], deltas.sum(axis=0))
    assert np.all(np.abs(velocity) <= np.array(SPEED) + 1)
    allowed = (1 + max(steps, 1)) * np.array(ACCELERATION) + 2
    assert np.all(np.abs(np.diff(velocity, axis=0)) <= allowed)
    if steps == 0:  # at rest on every corner
        knots = np.cumsum(deltas, axis=0)
        assert all(np.any(np.all(np.abs(at - k) <= 1, axis=1)) for k in knots)


@pytest.mark.parametrize("seed", range(4))
def test_every_sample_is_on_the_path(seed: int) -> None:
    rng = np.random.default_rng(seed)
    deltas = rng.integers(-4000, 4001, (8, 6))
    path = PathGenerator((100, -200, 300, 0, 5, 7))
    knots = np.vstack([path.at, path.at + np.cumsum(deltas, axis=0)])
    for row in lines(deltas):
        add(path, row, 60.0)
    samples = np.array(run(path))
    off = []
    for begin, delta in zip(knots[:-1], deltas, strict=True):
        u = np.clip((samples - begin) @ delta / (delta @ delta), 0.0, 1.0)
        off.append(np.max(np.abs(begin + u[:, None] * delta - samples), axis=1))
    assert np.all(np.min(off, axis=0) <= 1.0)


def test_cubics_inside_the_limits_run_in_their_own_time() -> None:
    distance = np.array([30000, -8000, 15000, 9000, -20000, 25000.0])
    path = PathGenerator((0,) * 6)
    for rows in cubics(60, distance):
        add(path, rows, 100.0)
    at = run(path)
    assert 6000 <= len(at) - 1 <= 6060  # facts, section 3: 60 cubics of 100 ms take 6.04 s
    assert np.array_equal(at[-1], distance)
    velocity = np.diff(at, axis=0)
    assert np.all(np.abs(velocity) <= np.array(SPEED) + 1)


def test_one_long_line_is_the_slowest_axis_trapezoid() -> None:
    path = PathGenerator((0,) * 6)
    add(path, [[60000], [0], [0], [0], [0], [0]])
    v, a = SPEED[0], ACCELERATION[0]
    assert len(run(path)) - 1 == pytest.approx(60000 / v + v / a, abs=3)


def test_a_dwell_lasts_exactly_its_time_and_lets_the_next_start_in_full() -> None:
    path = PathGenerator((3,) * 6)
    add(path, [[0, 0, 0]] * 6, 300.0)
    assert len(run(path)) - 1 in (300, 301)
    assert path.at == (3,) * 6


def test_a_starved_queue_stops_on_its_last_point_and_resumes() -> None:
    path = PathGenerator((0,) * 6)
    pieces = cubics(20, np.array([12000, 0, 0, 0, 0, 0.0]))
    for rows in pieces[:8]:
        add(path, rows, 100.0)
    first = run(path)
    expected = sum(sum(rows[0]) for rows in pieces[:8])
    assert first[-1][0] == expected
    assert np.max(np.abs(np.diff(first[:, 0], 2))) <= 2 * ACCELERATION[0] + 2
    for rows in pieces[8:]:
        add(path, rows, 100.0)
    assert run(path)[-1][0] == 12000


def test_segments_that_arrive_in_time_cost_nothing() -> None:
    pieces = cubics(20, np.array([12000, 0, 0, 0, 0, 0.0]))
    preloaded, fed = PathGenerator((0,) * 6), PathGenerator((0,) * 6)
    for rows in pieces:
        add(preloaded, rows, 100.0)
    whole = len(run(preloaded))
    ticks = 0
    for index, rows in enumerate(pieces):
        add(fed, rows, 100.0)
        while ticks < 60 * index:  # 60 ms a piece over the line, 100 ms to run it
            fed.tick()
            ticks += 1
    assert ticks + len(run(fed)) == pytest.approx(whole, abs=150)


@pytest.mark.parametrize("after_ms", [1, 40, 300, 777])
def test_stop_brakes_on_the_path_at_the_acceleration(after_ms: int) -> None:
    path = PathGenerator((0,) * 6)
    for rows in lines(np.tile(np.array([2000, -200, 300, 0, 0, 0]), (15, 1))):
        add(path, rows)
    moving = [path.at]
    for _ in range(after_ms):
        path.tick()
        moving.append(path.at)
    path.stop()
    at = run(path)
    whole = np.vstack([moving, at[1:]])
    assert len(at) - 1 <= SPEED[0] / ACCELERATION[0] + 3
    assert np.max(np.abs(np.diff(whole[:, 0], 2))) <= ACCELERATION[0] + 2
    direction = np.array([2000, -200, 300]) / 2000.0
    assert np.all(np.abs(whole[:, :3] - whole[:, :1] * direction) <= 1.0)
    assert whole[-1][0] < 30000


def test_a_segment_of_nothing_in_no_time_is_nothing() -> None:
    path = PathGenerator((1,) * 6)
    add(path, [[0]] * 6)
    assert not path.queue


def test_a_straight_way_whose_pace_changes_is_not_stopped_at() -> None:
    path = PathGenerator((0,) * 6)
    add(path, [[2000], [0], [0], [0], [0], [0]], 100.0)
    add(path, [[1000], [0], [0], [0], [0], [0]], 100.0)
    at = run(path)[:, 0]
    crossing = int(np.searchsorted(at, 2000))
    assert at[crossing] - at[crossing - 1] >= 9  # the second's own pace is 10 counts/ms
