"""Answers on tables whose truth is known."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cell.files.study import Study, read_study
from cell.study.answer.answers import Best, Points, best_of, influences, read_points, shares, shown, unsaid
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
    assert best.values == (420, 0)  # one step from the end of what was asked, as 440 is from what was refused
    assert best.room == 0.25
    assert best.between == ((420.0, 420.0), (0.0, 0.0))


def test_of_places_with_the_same_room_the_one_with_the_largest_margin_is_best(scenes: Path) -> None:
    grid = {"key": "seed", "file": "task", "values": [0, 1, 2, 3]}
    study = read_study(write_study(scenes, [{**X, "steps": 5}, grid]))
    table = _table(study, lambda x, _: x < 450.0, lambda _, seed: float(seed == 2))
    best = best_of(study, _points(study, table), lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values == (420, 2)


def test_where_nothing_was_refused_the_whole_grid_is_free(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 5}, {"key": "seed", "values": ["a", "b"]}]))
    best = best_of(study, _points(study, _table(study, lambda *_: True)), lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values == (460, "a")
    assert best.between == ((420.0, 500.0), None)


STEPS = {key: value for key, value in X.items() if key not in ("from", "to")}


@pytest.mark.parametrize(
    ("one", "room"),
    [({**X, "steps": 5}, 0.75), ({**X, "steps": 2}, 1.0), ({**STEPS, "values": [1, 5, 9]}, 1.0)],
)
def test_a_range_with_steps_ends_one_step_beyond_its_last(
    scenes: Path, one: dict[str, Any], room: float
) -> None:
    """Nobody asked what is there. Listed values have no beyond."""
    study = read_study(write_study(scenes, [one]))
    best = best_of(study, _points(study, _table(study, lambda *_: True)), lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.room == pytest.approx(room)


def test_what_was_not_computed_is_neither_passed_nor_refused(scenes: Path) -> None:
    """A chunk that was set aside says nothing of what matters."""
    study = read_study(write_study(scenes, [X, YAW], points=2048, seed=3, chunk=1024))
    rows = _table(study, lambda x, yaw: x < 447.0).splitlines(keepends=True)
    half, rest = Chunk(0, 0, 1024, ""), Chunk(1, 1024, 1024, "")
    points = read_points(study, [(half, "".join(rows[:1024])), (rest, None)])
    assert int(points.computed.sum()) == 1024
    found = {one.name: one for one in influences(study, points)}
    assert found["x"].share > 0.9
    all_pass = read_points(study, [(half, _table_of(rows[:1024])), (rest, None)])
    assert influences(study, all_pass) == []
    assert unsaid(study, all_pass, []).startswith("All points passed")


def _table_of(rows: list[str]) -> str:
    return "".join(row.replace(",0,left", ",1,").replace(",0,right", ",1,") for row in rows)


@pytest.mark.parametrize(
    ("one", "ends", "told"),
    [
        (X, (420.0004, 499.9996), ("450.00", "420.01", "499.99")),
        ({**X, "steps": 5}, (420.0, 500.0), ("450", "420", "500")),
        (
            {**X, "from": 1e-7, "to": 9e-7},
            (2e-7, 3.00000049e-7),
            ("450.0000000000", "0.0000002000", "0.0000003000"),
        ),
        ({"key": "seed", "values": ["a", "b"]}, None, ("450.0", "", "")),
    ],
)
def test_ends_are_rounded_inwards(
    scenes: Path, one: dict[str, Any], ends: tuple[float, float] | None, told: tuple[str, str, str]
) -> None:
    more = {} if "steps" in one or "values" in one else {"points": 2}
    varied = read_study(write_study(scenes, [one], **more)).vary[0]
    assert shown(varied, Best(0, (450.0,), 0.1, (ends,)), 0) == told


def test_what_was_not_computed_bounds_what_is_known(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 9}], chunk=3))
    rows = _table(study, lambda *_: True).splitlines(keepends=True)
    chunks = [Chunk(k, 3 * k, 3, "") for k in range(3)]
    points = read_points(
        study, [(chunks[0], "".join(rows[:3])), (chunks[1], "".join(rows[3:6])), (chunks[2], None)]
    )
    assert shares(points) == [("not computed", 3, 1 / 3)]
    best = best_of(study, points, lambda n: points_of(study, n, 1)[0])
    assert best is not None
    assert best.values == (440,)
    assert best.between == ((420.0, 460.0),)


def test_the_mean_of_points_of_a_narrow_range_is_inside_it(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "from": 1e-7, "to": 9e-7}], points=64))
    values = [x for (x,) in points_of(study, 0, 64)]
    assert len(set(values)) == 64
    assert min(values) >= 1e-7
    assert influences(study, _points(study, _table(study, lambda x: x < 4e-7)))[0].share > 0.8


def test_shares_are_counted_the_most_frequent_first(scenes: Path) -> None:
    study = _study(scenes, 256)
    points = _points(study, _table(study, lambda x, yaw: x > 480.0))
    assert shares(points)[0][:2] == ("left", 128)
    assert shares(points)[1][0] == "right"
    assert sum(n for _, n, _ in shares(points)) + points.ok.sum() == 256


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
        found = influences(study, Points(values, ok, reason, ("no",), {}))
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
