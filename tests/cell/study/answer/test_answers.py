"""Answers on tables whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.files.study import Study, read_study
from cell.study.answer.answers import Points, best_of, influences, read_points, shares
from cell.study.question.points import points_of
from cell.study.work.chunks import Chunk
from studies.written import YAW, X, write_study


def _table(study: Study, passes: Any, margin: Any = lambda *_: 1.0) -> str:
    rows = []
    for number, values in enumerate(points_of(study, 0, study.count)):
        ok = passes(*values)
        why = "" if ok else ("left" if values[0] < 460.0 else "right")
        cells = [number, *values, "reach", int(ok), why, margin(*values) if ok else "", "", "", "", ""]
        rows.append(",".join(map(str, cells)))
    return "\n".join(rows)


def _points(study: Study, table: str) -> Points:
    return read_points(study, [(Chunk(0, 0, study.count, ""), table)])


def _study(scenes: Path, count: int = 2048) -> Study:
    return read_study(write_study(scenes, [X, YAW], points=count, seed=1))


def test_the_best_place_is_in_the_middle_of_what_passes(scenes: Path) -> None:
    study = _study(scenes)
    points = _points(study, _table(study, lambda x, yaw: abs(x - 450.0) < 20.0))
    best = best_of(study, points, lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values[0] == pytest.approx(450.0, abs=4.0)
    assert best.between[0] == pytest.approx((430.0, 470.0), abs=4.0)
    assert best.between[1] is not None
    assert np.diff(best.between[1]) == pytest.approx(30.0, abs=6.0)  # the same share of its range


def test_the_end_of_a_range_bounds_what_is_known(scenes: Path) -> None:
    study = _study(scenes)
    points = _points(study, _table(study, lambda *_: True))
    best = best_of(study, points, lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values[0] == pytest.approx(460.0, abs=3.0)
    assert best.between[0] == pytest.approx((420.0, 500.0), abs=3.0)


def test_no_place_is_best_where_none_passes(scenes: Path) -> None:
    study = _study(scenes, 16)
    points = _points(study, _table(study, lambda *_: False))
    assert best_of(study, points, lambda n: points_of(study, n, 1)[0]) is None
    assert influences(study, points) == []


def test_a_grid_changes_in_whole_steps(scenes: Path) -> None:
    grid = {"key": "seed", "file": "task", "values": [0, 1, 2, 3, 10]}
    study = read_study(write_study(scenes, [{**X, "steps": 5}, grid]))
    points = _points(study, _table(study, lambda x, seed: x < 450.0))
    best = best_of(study, points, lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values == (420.0, 0)
    assert best.room == 0.5
    assert best.between == ((420.0, 440.0), (0.0, 1.0))  # 460 was refused


def test_where_nothing_was_refused_the_whole_grid_is_free(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 5}, {"key": "seed", "values": ["a", "b"]}]))
    best = best_of(study, _points(study, _table(study, lambda *_: True)), lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.between == ((420.0, 500.0), None)


def test_what_was_not_computed_bounds_what_is_known(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 9}], chunk=3))
    rows = _table(study, lambda *_: True).splitlines(keepends=True)
    chunks = [Chunk(k, 3 * k, 3, "") for k in range(3)]
    points = read_points(
        study, [(chunks[0], "".join(rows[:3])), (chunks[1], "".join(rows[3:6])), (chunks[2], None)]
    )
    assert shares(study, points) == [("not computed", 3, 1 / 3)]
    best = best_of(study, points, lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values == (420.0,)
    assert best.between == ((420.0, 470.0),)


def test_the_mean_of_points_of_a_narrow_range_is_inside_it(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "from": 1e-7, "to": 9e-7}], points=64))
    values = [x for (x,) in points_of(study, 0, 64)]
    assert len(set(values)) == 64
    assert min(values) >= 1e-7
    assert influences(study, _points(study, _table(study, lambda x: x < 4e-7)))[0].share > 0.8


def test_shares_are_counted_the_most_frequent_first(scenes: Path) -> None:
    study = _study(scenes, 256)
    points = _points(study, _table(study, lambda x, yaw: x > 480.0))
    assert shares(study, points)[0][:2] == ("left", 128)
    assert shares(study, points)[1][0] == "right"
    assert sum(n for _, n, _ in shares(study, points)) + points.ok.sum() == 256


@pytest.mark.parametrize("seed", range(3))
def test_what_decides_has_the_whole_share_and_what_does_not_has_none(scenes: Path, seed: int) -> None:
    study = read_study(write_study(scenes, [X, YAW], points=2048, seed=seed))
    found = {i.name: i for i in influences(study, _points(study, _table(study, lambda x, yaw: x < 447.0)))}
    assert found["x"].share > 0.9
    assert found["yaw"].low <= 0.01
    assert found["yaw"].share < 0.01


def test_nothing_is_said_of_a_value_with_one_point_in_each_bin(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 9}]))
    assert influences(study, _points(study, _table(study, lambda x: x < 447.0))) == []


def test_chance_is_not_taken_for_influence(scenes: Path) -> None:
    """Of a fair coin nothing depends on x and yaw: the mean over many draws is near 0, not the share of 12 bins."""
    study, rng = _study(scenes, 64), np.random.default_rng(5)
    found = []
    for _ in range(30):
        points = _points(study, _table(study, lambda *_: bool(rng.random() < 0.5)))
        found += [one.share for one in influences(study, points)]
    assert np.mean(found) < 0.1


BINS = 12  # of a range
ANSWERS = {  # probability that a point at (x, yaw), as shares of their ranges, passes
    "additive": lambda x, y: (x + y) / 2.0,
    "step": lambda x, y: (x < 0.35) + 0.0 * y,
    "corner": lambda x, y: ((x < 0.5) & (y < 0.6)) + 0.0,
    "rare": lambda x, y: ((x < 0.3) & (y < 0.3)) + 0.0,
    "weak": lambda x, y: 0.45 + 0.1 * x + 0.0 * y,
    "chance": lambda x, y: 0.5 + 0.0 * x * y,
}


@pytest.mark.parametrize("answer", list(ANSWERS))
@pytest.mark.parametrize("n", [128, 1024])
def test_the_intervals_hold_the_truth_as_often_as_they_say(scenes: Path, answer: str, n: int) -> None:
    study, chance = _study(scenes, n), ANSWERS[answer]
    middle = (np.arange(100 * BINS) + 0.5) / (100 * BINS)
    all_x = chance(middle[:, None], middle[None, :])
    bins = [all_x.mean(axis=1 - k).reshape(BINS, -1).mean(axis=1) for k in range(2)]
    truth = [np.var(of) / (all_x.mean() * (1.0 - all_x.mean())) for of in bins]
    inside, draws = 0, 40
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        values = rng.random((n, 2))
        ok = rng.random(n) < chance(*values.T)
        reason = np.where(ok, -1, 0).astype(np.int32)
        found = influences(study, Points(np.arange(n), values, ok, reason, ("no",), {}))
        at = {"x": truth[0], "yaw": truth[1]}
        inside += sum(one.low - 1e-9 <= at[one.name] <= one.high + 1e-9 for one in found)
    assert (
        inside >= 0.85 * 2 * draws
    )  # four standard deviations of a binomial below 95 %, and what few points cost


def test_an_additive_answer_is_shared_as_theory_says(scenes: Path) -> None:
    """Of a coin that falls with probability (x + y)/2, x and y each explain 1/12 of the variance."""
    study, rng = _study(scenes, 16384), np.random.default_rng(2)

    def passes(x: float, yaw: float) -> bool:
        return bool(rng.random() < ((x - 420.0) / 80.0 + (yaw - 60.0) / 60.0) / 2.0)

    for one in influences(study, _points(study, _table(study, passes))):
        assert one.low < 1.0 / 12.0 < one.high
        assert one.share == pytest.approx(1.0 / 12.0, abs=0.012)
