"""Position samples of a wire log, on one clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.log.read import Session, read_log
from wire.logged_session import LoggedRun
from wire.written_log import write


def answers(*rows: tuple[float, int, int]) -> list[dict[str, Any]]:
    """COORDAP answers heard at a time, with the unit's ms and the first axis."""
    return [{"t": t, "kind": "received", "data": f"COORDAP={ms},1,0,{a},0,0,0,0,0\r\n"} for t, ms, a in rows]


def test_samples_are_where_the_arm_was_at_the_units_own_time(session: Session, run: LoggedRun) -> None:
    """The emulator knows where the arm was at each ms; the two clocks differ by one constant."""
    times = np.array([s.time_s for s in session.samples])
    counts = np.array([s.position.counts for s in session.samples])
    assert len(times) > 25
    assert np.all(np.diff(times) >= 0.0)
    assert all(s.time_s <= s.heard_s + 1e-9 for s in session.samples)
    unit_ms = np.rint(1e3 * (times - times[0])).astype(int) + session.samples[0].position.time_ms
    assert [int(v) % 65536 for v in unit_ms] == [s.position.time_ms for s in session.samples]
    rows = np.searchsorted(run.record.time_ms, unit_ms, side="right") - 1
    homed = np.flatnonzero([s.heard_s > session.homed_s for s in session.samples])[
        1:
    ]  # which set counts anew
    for sampled, row in zip(counts[homed], rows[homed], strict=True):
        around = run.record.counts[max(row - 1, 0) : row + 2]
        assert np.any(np.all(around == sampled, axis=1)), (sampled, around)


def test_samples_know_their_segment(session: Session) -> None:
    (motion,) = [m for m in session.motions if m.path is not None and m.stopped_s is None]
    path = motion.path
    assert path is not None
    found = [(s.position.counts, motion.segment_of(s)) for s in motion.samples]
    assert [i for _, i in found if i is not None] == sorted(i for _, i in found if i is not None)
    ends = np.cumsum([s.duration_ms for s in path.segments]) / 1e3
    for counts, index in found:
        assert index is not None
        first, last = (0.0, 0.0) if index < 0 else (ends[index - 1] if index else 0.0, ends[index])
        stretch = path.at(np.linspace(first, last, 200))
        assert np.abs(stretch - counts).max(axis=1).min() <= 12


def test_the_units_clock_wraps_and_the_hosts_delays_are_not_seen(tmp_path: Path) -> None:
    """Ten samples 20 s apart over three wraps, each heard with another delay."""
    rng = np.random.default_rng(4)
    truth = 20.0 * np.arange(10)
    late = rng.uniform(0.0, 0.9, 10)
    late[3] = 0.0
    rows = [(5.0 + t + d, int(60_000 + 1e3 * t) % 65536, 0) for t, d in zip(truth, late, strict=True)]
    session = read_log(write(tmp_path / "log.jsonl", *answers(*rows)))
    assert [s.time_s for s in session.samples] == pytest.approx(5.0 + truth, abs=1e-9)
    assert session.damaged == 0


def test_a_unit_that_was_switched_off_begins_a_new_clock_and_a_damaged_one_is_left_out(
    tmp_path: Path,
) -> None:
    rows = [(1.0, 1000, 1), (2.0, 2000, 2), (3.0, 30000, 3), (4.0, 4000, 4), (60.0, 500, 5), (61.0, 1500, 6)]
    session = read_log(write(tmp_path / "log.jsonl", *answers(*rows)))
    assert [(s.time_s, s.position.counts[0]) for s in session.samples] == [
        (1.0, 1),
        (2.0, 2),
        (4.0, 4),
        (60.0, 5),
        (61.0, 6),
    ]
    assert session.damaged == 1
