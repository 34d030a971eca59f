"""A point is known by its number alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cell.files.study import read_study
from cell.study.question.points import points_of
from studies.written import YAW, X, write_study


@pytest.mark.parametrize(("first", "count"), [(0, 1), (3, 20), (3, 14), (17, 30), (60, 4)])
def test_any_part_is_that_of_the_whole(scenes: Path, first: int, count: int) -> None:
    grid = {"key": "noise_grey", "values": [1.0, 2.0, 3.0, 4.0]}
    study = read_study(write_study(scenes, [X, grid, YAW], points=16, seed=4))
    assert points_of(study, first, count) == points_of(study, 0, study.count)[first : first + count]


def test_samples_fill_their_ranges_evenly_and_grids_have_each_value(scenes: Path) -> None:
    grid = {"key": "noise_grey", "values": [1.0, 2.0]}
    study = read_study(write_study(scenes, [grid, X, YAW], points=256, seed=3))
    points = points_of(study, 0, study.count)
    assert [value for value, *_ in points] == [1.0] * 256 + [2.0] * 256
    x = np.array([[a, b] for _, a, b in points[:256]])
    for k, (low, high) in enumerate([(420.0, 500.0), (60.0, 120.0)]):
        counts, _ = np.histogram(x[:, k], bins=16, range=(low, high))
        assert (counts == 16).all()


def test_another_seed_gives_other_points(scenes: Path) -> None:
    one = points_of(read_study(write_study(scenes, points=8, seed=1)), 0, 8)
    assert one != points_of(read_study(write_study(scenes, points=8, seed=2)), 0, 8)


def test_the_last_grid_varies_fastest(scenes: Path) -> None:
    grids = [{"key": "noise_grey", "values": [1.0, 2.0]}, {"key": "seed", "values": [5, 6, 7]}]
    study = read_study(write_study(scenes, grids))
    assert points_of(study, 0, 6) == [(1.0, 5), (1.0, 6), (1.0, 7), (2.0, 5), (2.0, 6), (2.0, 7)]
