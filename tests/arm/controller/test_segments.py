"""Segments: displacement, derivatives by finite differences, chains in time."""

import numpy as np
import pytest

from arm.controller.segments import CountPath, Segment


def _random_path(seed: int, count: int = 20) -> CountPath:
    rng = np.random.default_rng(seed)
    segments = [
        Segment(
            int(rng.integers(20, 200)),
            tuple(tuple(int(v) for v in row) for row in rng.integers(-500, 500, (order, 6))),
        )
        for order in rng.integers(1, 4, count)
    ]
    return CountPath(tuple(int(v) for v in rng.integers(-100000, 100000, 6)), tuple(segments))


def test_end_is_the_integer_sum() -> None:
    path = _random_path(1)
    total = np.array(path.start)
    for segment in path.segments:
        assert segment.derivative(1.0, 0) == pytest.approx(segment.end())
        total = total + segment.end()
    assert path.end == tuple(total)


def test_derivatives_match_finite_differences() -> None:
    h = 1e-5
    for segment in _random_path(2).segments:
        u = np.array([0.2, 0.5, 0.9])
        seconds = segment.duration_ms / 1e3
        velocity = (segment.derivative(u + h, 0) - segment.derivative(u - h, 0)) / (2 * h * seconds)
        acceleration = (segment.derivative(u + h) - segment.derivative(u - h)) / (2 * h * seconds)
        assert segment.derivative(u) == pytest.approx(velocity, rel=1e-6, abs=1e-3)
        assert segment.derivative(u, 2) == pytest.approx(acceleration, rel=1e-6, abs=1e-2)


def test_sampling_meets_every_knot_and_is_continuous() -> None:
    path = _random_path(3)
    ends = np.concatenate([[0], np.cumsum([s.duration_ms for s in path.segments])]) / 1e3
    assert path.at(ends) == pytest.approx(path.knots(), abs=1e-6)
    assert path.at(ends[1:-1] - 1e-9) == pytest.approx(path.knots()[1:-1], abs=1e-2)
    grid = path.sample()
    assert len(grid) == round(path.duration_s * 1e3) + 1
    assert grid[-1] == pytest.approx(path.end)


def test_counts_are_clamped_to_both_ends_of_the_motion() -> None:
    path = _random_path(4)
    assert path.at([-1.0, path.duration_s + 1.0]) == pytest.approx(np.array([path.start, path.end]))
    still = CountPath((1, 2, 3, 4, 5, 6), ())
    assert still.end == still.start
    assert still.at([0.0, 1.0]) == pytest.approx(np.array([still.start] * 2))


@pytest.mark.parametrize("seed", range(20))
def test_extremes_bound_a_dense_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [tuple(tuple(int(c) for c in r) for r in rng.integers(-3000, 3000, (3, 6))) for _ in range(4)]
    path = CountPath((0, 12, -7, 90000, 5, -1), tuple(Segment(100, r) for r in rows))
    low, high = path.extremes()
    dense = path.sample(1e-4)
    assert (dense >= low - 1e-6).all()
    assert (dense <= high + 1e-6).all()
    assert (dense.min(axis=0) - low).max() < 3.0
    assert (high - dense.max(axis=0)).max() < 3.0
