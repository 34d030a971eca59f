"""Motions of a threaded ring that are wrong on purpose are refused, and what an oracle calls right is what it says."""

from __future__ import annotations

from collections import Counter
from functools import cache

import numpy as np
import pytest
from hoop_bench.thread_oracle import closed, linking
from hoop_bench.wrong_motions import OTHERS, Right, over_the_end, plan_with, right_motion

from arm.errors import A465Error
from arm.io.storage import data_file
from cell.program.program_file import read_program
from cell.task.plan_matches import check_plan

KINDS = {"over the free end": over_the_end, **OTHERS}
CIRCLE = np.array([(np.cos(a), np.sin(a), 0.0) for a in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)])


@cache
def _right() -> Right:
    return right_motion(read_program(data_file("scenes/hoop/b.toml")))


def _accepted(of: Right, q: np.ndarray, stated: str | None = "b") -> bool:
    try:
        check_plan(of.task, plan_with(of, q, stated))
    except A465Error:
        return False
    return True


def test_the_oracle_counts_how_often_a_line_passes_through_a_circle() -> None:
    line = closed(np.array([(0.0, 0.0, -0.1), (0.0, 0.0, 0.2), (0.1, 0.0, 0.3)]))
    for radius in (0.03, 0.06):
        for centre, count in (
            ((0.0, 0.0, 0.0), 1),
            ((0.1, 0.0, 0.1), 0),
            ((0.3, 0.0, 0.5), 1),
            ((0, 0, 0.5), 0),
        ):
            ring = radius * CIRCLE + np.array(centre)
            assert linking(ring, line) == pytest.approx(count, abs=1e-9)
            assert linking(ring[::-1], line) == pytest.approx(-count, abs=1e-9)
    twice = closed(
        np.array([(0, 0, -1), (0, 0, 1), (5, 0, 1), (5, 0, -1), (0.01, 0, -1), (0.01, 0, 1)], dtype=float)
    )
    assert linking(0.1 * CIRCLE, twice) == pytest.approx(2.0, abs=1e-9)


@pytest.mark.slow
def test_the_right_motion_is_right_and_accepted_and_one_over_the_free_end_is_not() -> None:
    of, rng = _right(), np.random.default_rng(3)
    whole = np.concatenate([of.q, of.q[-2::-1]])
    judged = of.oracle.judge(whole, of.task.required)
    assert judged.linked
    assert judged.least > of.task.required
    assert _accepted(of, whole)
    clear = 0
    while clear < 3:
        q = over_the_end(of, rng)
        if q is None:
            continue
        judged = of.oracle.judge(q, of.task.required)
        assert not judged.linked
        assert not _accepted(of, q)
        assert not _accepted(of, q, None)
        clear += judged.bodies > of.task.required  # then nothing but the ray tells that it is wrong


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_wrong_motions_of_every_kind_are_refused(kind: str) -> None:
    of, rng, seen = _right(), np.random.default_rng([7, len(kind)]), Counter[str]()
    while seen["wrong"] < 4:
        q = KINDS[kind](of, rng)
        if q is None:
            continue
        judged = of.oracle.judge(q, of.task.required)
        wrong = not judged.linked or judged.least < of.task.required - 1e-4
        seen["wrong"] += wrong
        assert not (wrong and _accepted(of, q))


@pytest.mark.slow
def test_the_oracles_distance_is_that_of_the_ring_and_the_bar() -> None:
    of = _right()
    middle = len(of.q) // 2
    judged = of.oracle.judge(of.q[middle : middle + 2], 0.0)
    least = min(move.clearance for move in of.plan.moves if move.threaded)
    assert judged.bodies > least - 1e-4
