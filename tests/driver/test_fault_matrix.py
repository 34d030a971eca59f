"""One case of every fault, the moments in turn; all cells with many seeds are in bench/faults.py."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from wire.fault_matrix import EXPECTED, MOMENTS, NAMES, run_case

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


@pytest.mark.parametrize("off_deg", [0.0, 0.019, 0.021, 5.0])
def test_a_void_certificate_is_not_as_expected(tmp_path: Path, off_deg: float) -> None:
    sound = replace(run_case("noise", "idle", seed=0, folder=tmp_path), off_deg=off_deg)
    assert sound.as_expected == (off_deg < 0.02)
    assert replace(sound, name="axis drifts", seen="refuses").as_expected  # its mechanics fail


def test_an_arm_off_its_path_is_measured(tmp_path: Path) -> None:
    """Segments that the unit drops behind its echo."""
    assert run_case("queue overflows", "idle", seed=0, folder=tmp_path).off_deg > 1.0
    assert 0.0 < run_case("arm power off", "streaming", seed=0, folder=tmp_path).off_deg < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_a_unit_that_was_switched_off_while_it_gripped_holds_nothing(tmp_path: Path, seed: int) -> None:
    assert run_case("unit switched off and on", "gripping", seed, tmp_path).seen == "stops"


@pytest.mark.parametrize(("moment", "seed"), [("waiting", 1), ("idle", 1), ("streaming", 3), ("waiting", 4)])
def test_where_no_stop_comes_back_the_arm_is_still_seen_to_stand(
    tmp_path: Path, moment: str, seed: int
) -> None:
    """Three of ten lines come back garbled, some with the answer behind them."""
    assert run_case("echo garbled", moment, seed, tmp_path).as_expected
