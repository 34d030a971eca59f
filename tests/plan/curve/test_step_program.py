"""Quadratic programs of steps: rows that cannot bind are left out, and the solution is that of all rows."""

from __future__ import annotations

import numpy as np
import pytest
import qpsolvers

from arm.robot.model import Robot
from arm.se3 import Array
from plan.collision.world import World
from plan.curve.step_program import Rows, StepProgram, _reached
from tasks.pose_lists import TABLE

M, N, F = 9, 6, 4
MM = 1e-3
TOLERANCE = 2e-5


def drawn(rng: np.random.Generator, widened: bool) -> tuple[StepProgram, list[Rows], Array]:
    """Return a program whose rows bind in places, its rows, and its bounds."""
    D = rng.normal(size=(M, N, F))
    steps = 0.05 * rng.normal(size=(M - 1, N))
    rows = []
    for count, room, sides in ((200, 0.05, (MM, 0.0)), (200 if widened else 0, 0.1, (0.0, MM))):
        station = rng.integers(0, M, count)
        slack = rng.random(count) * (rng.random(count) < 0.9)  # most are far from what bounds reach
        there = rng.normal(size=(count, F)) * (station < M - 1)[:, None] * rng.integers(0, 2, count)[:, None]
        rows.append(
            Rows(
                station,
                rng.normal(size=(count, F)),
                there,
                rng.uniform(-0.01, room, count) + 0.5 * slack,
                *sides,
            )
        )
    bound = rng.uniform(0.0, 0.2, (M, F))
    bound[rng.random((M, F)) < 0.2] = 0.0
    return StepProgram(D, steps, np.linspace(1.0, 3.0, N), rows, widened), rows, bound


def matrix(rows: Rows) -> Array:
    """Return the rows (k, m f + 2), written one by one."""
    G = np.zeros((len(rows.room), M * F + 2))
    for line, at, here, there in zip(G, rows.station, rows.here, rows.there, strict=True):
        line[at * F : (at + 1) * F] = here
        if at < M - 1:
            line[(at + 1) * F : (at + 2) * F] = there
        line[-2:] = -rows.missing, rows.least
    return G


@pytest.mark.parametrize("widened", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_the_step_is_that_of_all_rows_at_once(seed: int, widened: bool) -> None:
    """Against another solver."""
    rng = np.random.default_rng(seed)
    program, rows, bound = drawn(rng, widened)
    more = Rows(np.array([0, 3]), rng.normal(size=(2, F)), np.zeros((2, F)), np.array([1e-3, 0.0]))
    for region in (1.0, 0.3, 0.1):
        high = region * bound
        step = program.solved(-high, high, more)
        G = np.concatenate([matrix(some) for some in (*rows, more)])
        h = np.concatenate([some.room for some in (*rows, more)])
        whole = qpsolvers.solve_qp(
            program._P,
            program._linear,
            G,
            h,
            lb=np.append(-high.ravel(), [0.0, -1e3]),
            ub=np.append(high.ravel(), [1e3, 1e3]),
            solver="daqp",
        )
        assert step is not None
        assert whole is not None
        assert (np.abs(step) <= high + 1e-9).all()
        # both missing clearance and least distance are free: what they are at best
        best = np.append(step.ravel(), whole[-2:])
        assert (G @ best <= h + 5.0 * TOLERANCE).all()
        cost = [0.5 * x @ program._P @ x + program._linear @ x for x in (best, whole)]
        assert cost[0] == pytest.approx(cost[1], abs=1e-2 * max(1.0, abs(cost[1])))


@pytest.mark.parametrize("widened", [False, True])
def test_rows_that_are_left_out_cannot_bind(widened: bool) -> None:
    """At no change between the bounds, with the largest least distance that there is; many are left out."""
    rng = np.random.default_rng(3)
    _, every, bound = drawn(rng, widened)
    bound *= 0.3
    for rows in every[: 2 if widened else 1]:
        left = ~_reached(rows, -bound, bound)
        assert left.mean() > 0.3
        for _ in range(200):
            x = rng.choice([-1.0, 0.0, 1.0], bound.shape) * bound
            change = matrix(rows)[:, :-2] @ x.ravel()
            least = (rows.room - change).min() if rows.least else 0.0
            assert (change + least <= rows.room + 1e-12)[left].all()


def test_rows_of_distances_are_what_a_small_change_takes_off(robot: Robot) -> None:
    """At stations and at the middles between them, against distances computed anew."""
    world = World(robot, [TABLE])
    rng = np.random.default_rng(7)
    q = np.radians([0.0, -20.0, -60.0, 0.0, -70.0, 0.0]) + np.cumsum(0.05 * rng.normal(size=(5, 6)), axis=0)
    D, size = rng.normal(size=(5, 6, F)), 1e-5
    middles = np.concatenate([q, 0.5 * (q[1:] + q[:-1])])
    near = world.near(middles, 1.0)
    rows = Rows.of_distances(near, D, near.distance, True)
    assert (rows.missing, rows.least) == (MM, 0.0)
    x = rng.normal(size=(5, F))
    moved = q + size * (D @ x[..., None])[..., 0]
    then = world.near(np.concatenate([moved, 0.5 * (moved[1:] + moved[:-1])]), 1.1)
    after = {(r, p): d for r, p, d in zip(then.row.tolist(), then.pair.tolist(), then.distance, strict=True)}
    following = x[np.minimum(rows.station + 1, 4)]
    taken = size * ((rows.here * x[rows.station]).sum(axis=1) + (rows.there * following).sum(axis=1))
    assert len(near.row) > 20
    for row, pair, before, less in zip(
        near.row.tolist(), near.pair.tolist(), near.distance, taken, strict=True
    ):
        assert before - after[row, pair] == pytest.approx(less, abs=2e-8)
