"""Motions of a wire log: the segments sent, exactly."""

from __future__ import annotations

from pathlib import Path

import pytest

from driver.line.protocol import Position
from driver.log.motions import LoggedMotion, _sampled
from driver.log.read import Session, read_log
from driver.log.samples import LoggedSample
from wire.logged_session import LoggedRun
from wire.written_log import write


def test_segments_are_those_sent_with_their_motion_and_exact_starts(session: Session, run: LoggedRun) -> None:
    streams = [m for m in session.motions if m.target is None]
    moves = [m.target for m in session.motions if m.target is not None]
    assert moves == [(0,) * 6, run.home, run.whole.start]  # the first goes where the arm stands
    whole, cut = streams
    assert whole.path == run.whole
    assert whole.start_exact
    assert (whole.stopped_s, whole.dwell_ms >= 300) == (None, True)
    assert cut.start == run.cut.start
    assert 12 <= len(cut.segments) < 40
    assert cut.segments == run.cut.segments[: len(cut.segments)]
    assert cut.stopped_s in session.stops
    assert cut.ready_s is None


def test_lines_are_put_together_over_records_and_a_stop_cuts_one(tmp_path: Path) -> None:
    sent = [
        "COORDMV:1,2,3,",
        "4,5,6\n",
        "COORDSPLINET:100,1,9,9,9,9,9,9\nCOORDSPL",
        "INET:100,1,7,7,7,7,7,7",
        "\nSTOP:\n",
    ]
    records = [{"t": float(i), "kind": "sent", "data": text} for i, text in enumerate(sent)]
    heard = [
        {"t": 9.0, "kind": "received", "data": text} for text in ("ST", "=655", "52\r", "\nR!\r\nST=x\r\n")
    ]
    session = read_log(write(tmp_path / "log.jsonl", *records, *heard))
    move, stream = session.motions
    assert (move.target, move.sent_s) == ((1, 2, 3, 4, 5, 6), 1.0)
    assert stream.start == (1, 2, 3, 4, 5, 6)
    assert [s.coefficients for s in stream.segments] == [((9,) * 6,)]
    assert stream.stopped_s == 4.0
    assert [(line.text[:9], line.cut) for line in session.sent[-2:]] == [
        ("COORDSPLI", True),
        ("STOP:", False),
    ]
    assert session.statuses[0].status.faults() == ("arm power is off",)
    assert session.damaged == 1


@pytest.mark.parametrize(
    ("rate", "times_s"),
    [
        (1.0, (0.05, 0.20, 0.37, 0.45, 0.80)),
        (2.0, (0.05, 0.39, 0.70, 1.0, 1.4)),
        (0.99, (0.05, 0.2, 0.38, 0.6)),
    ],
)
def test_the_first_sample_after_the_dwell_was_sent_gives_its_number(
    rate: float, times_s: tuple[float, ...]
) -> None:
    """Samples of a unit `rate` times as fast as the log's clock: a later one may be of a segment."""
    dwell_s, motion = 0.374, LoggedMotion(10.0, dwell_ms=374, dwell_s=10.0)
    samples = tuple(
        LoggedSample(
            10.0 + t,
            10.0 + t / rate,
            Position(round(1e3 * t), 5 if t < dwell_s else 6 + int(10 * t), 0, (0,) * 6),
        )
        for t in times_s
    )
    assert _sampled(motion, samples).number == 5
