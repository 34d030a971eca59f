"""An arm that a cube on the rim holds back, by its counters."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from arm.io.storage import data_file
from arm.numerics.products import mul
from arm.se3 import transform
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.cubes.held_back import LEAST_SIGMAS, held_back
from plan.kinematics.ik import inverse_kinematics

SENT_RAD = np.radians([-20.0, -30.0, -85.0, 5.0, -60.0, 10.0])


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(data_file("scenes/realistic/cell.toml"))


def _counts(cell: Cell, q: np.ndarray) -> tuple[int, ...]:
    return tuple(int(c) for c in cell.unit.counts(q))


@pytest.mark.parametrize("back_mm", [-0.5, 0.0, 0.4, 1.2])
def test_the_distance_is_along_the_tool_and_out_of_the_pocket(cell: Cell, back_mm: float) -> None:
    """The arm rests where the whole tool is back; sideways errors do not count."""
    robot, sent = cell.robot_holding(), _counts(cell, SENT_RAD)
    T = robot.T_base_tool(cell.unit.positions(sent))
    for aside in (0.0, 3e-4):
        there = mul(T, transform(t=(aside, -aside, -1e-3 * back_mm)))
        found = inverse_kinematics(robot, there, cell.unit.lower, cell.unit.upper).q
        q = min(found, key=lambda q: float(np.abs(q - SENT_RAD).max()))
        held = held_back(cell, sent, _counts(cell, q))
        assert 1e3 * held.by == pytest.approx(back_mm, abs=0.03)
        assert held.by_contact == (1e-3 * back_mm > held.expected)


def test_no_arm_within_the_rest_tolerance_counts_as_held_back(cell: Cell) -> None:
    """Without a following error of the cell file; the worst such arm is at the limit."""
    sent, worst = _counts(cell, SENT_RAD), 0.0
    for signs in product((-1, 1), repeat=6):
        off = cell.unit.rest_tolerance * np.array(signs)
        held = held_back(cell, sent, [s + int(o) for s, o in zip(sent, off, strict=True)])
        assert held.by <= held.expected + 1e-12
        worst = max(worst, held.by / held.expected)
    assert worst == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("sigmas", [0.0, 3.0, 5.0])
def test_the_budgets_following_error_sets_the_limit(cell: Cell, sigmas: float) -> None:
    """Drawn arms exceed k standard deviations as rarely as a normal error does."""
    sigma = np.radians(0.01)
    known = replace(cell, following_error=sigma, sigmas=sigmas)
    sent, rng = _counts(cell, SENT_RAD), np.random.default_rng(6)
    by = []
    for _ in range(200):
        off = rng.normal(0.0, sigma, 6) * np.abs(cell.unit.counts_per_rad)
        by.append(held_back(known, sent, np.add(sent, np.rint(off).astype(int)).tolist()))
    expected = by[0].expected
    k = max(sigmas, LEAST_SIGMAS)
    assert np.std([held.by for held in by]) == pytest.approx(expected / k, rel=0.15)
    assert sum(held.by_contact for held in by) <= 2  # 0.3 expected at three
    assert "0.0 mm at the release" in held_back(known, sent, sent).words()
