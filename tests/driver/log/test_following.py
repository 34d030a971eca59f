"""Following error at rest: as the emulated axes truly are off, and only where the end of a motion is known."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from driver.log.following import rests_of
from driver.log.read import Session, read_log
from wire.erring_axes import ABSOLUTE_MOVES, erring_log


def test_rests_are_off_as_the_axes_are(tmp_path: Path) -> None:
    off = np.random.default_rng(3).integers(-12, 13, (5, 6))
    erring_log(tmp_path / "wire.jsonl", off.tolist())
    every = rests_of(read_log(tmp_path / "wire.jsonl"))
    moves, rests = every[:ABSOLUTE_MOVES], every[ABSOLUTE_MOVES:]
    assert all(rest.off == (0,) * 6 for rest in moves)
    assert [rest.off for rest in rests] == [tuple(row) for row in off.tolist()]
    assert all(a.time_s < b.time_s for a, b in pairwise(every))


def test_an_axis_that_lags_has_arrived_when_it_rests(tmp_path: Path) -> None:
    erring_log(tmp_path / "wire.jsonl", [[0] * 6] * 3, lag_ms=30.0)
    session = read_log(tmp_path / "wire.jsonl")
    assert np.abs([rest.off for rest in rests_of(session)]).max() <= 1
    behind = session.motions[-1]
    assert behind.ready_s is not None
    assert behind.path is not None
    at_ready = next(sample for sample in behind.samples[::-1] if sample.heard_s < behind.ready_s - 0.3)
    assert np.abs(np.subtract(at_ready.position.counts, behind.path.end)).max() > 10


def test_a_motion_that_was_stopped_says_nothing(session: Session) -> None:
    whole, cut = (motion for motion in session.motions if motion.target is None)
    rests = rests_of(session)
    assert all(rest.off == (0,) * 6 for rest in rests)
    assert len(rests) == ABSOLUTE_MOVES + 1  # and the whole stream
    assert cut.stopped_s is not None
    assert whole.ready_s is not None
    assert max(rest.time_s for rest in rests) < cut.sent_s
