"""One case of every fault, the moments in turn; all cells with many seeds are in bench/faults.py."""

from __future__ import annotations

from pathlib import Path

import pytest

from fault_matrix import EXPECTED, MOMENTS, NAMES, run_case

# Where a fault is felt most; the others take the moments in turn.
FELT = {"grasp missed": "gripping", "answer lost": "homing"}


@pytest.mark.parametrize("name", NAMES)
def test_a_fault_ends_as_written_down(name: str, tmp_path: Path) -> None:
    moment = FELT.get(name, MOMENTS[NAMES.index(name) % len(MOMENTS)])
    outcome = run_case(name, moment, seed=0, folder=tmp_path)
    assert outcome.as_expected, outcome
    assert outcome.played_s < 2.5  # look-ahead, dwell and braking


def test_every_cell_says_what_is_expected() -> None:
    assert len(NAMES) >= 15
    assert all(len(row) == len(MOMENTS) >= 5 for row in EXPECTED.values())
