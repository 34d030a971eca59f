"""A wire log read back: what was sent, where the arm was, on the unit's clock; and damage that is counted."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm.errors import FileInputError
from driver.log.read import Session, is_log, read_log
from wire.logged_session import LoggedRun

OPEN = {"t": 0.0, "kind": "open", "time_scale": 1.0}


def write(path: Path, *records: dict[str, Any]) -> Path:
    path.write_text("".join(json.dumps(r) + "\n" for r in (OPEN, *records)))
    return path


def answers(*rows: tuple[float, int, int]) -> list[dict[str, Any]]:
    """COORDAP answers heard at a time, with the unit's ms and the first axis."""
    return [{"t": t, "kind": "received", "data": f"COORDAP={ms},1,0,{a},0,0,0,0,0\r\n"} for t, ms, a in rows]


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
    assert list(whole.segments_sent_s) == sorted(whole.segments_sent_s)


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


def test_jaws_status_version_and_notes_are_there(session: Session) -> None:
    assert session.version.startswith("MARS8")
    assert session.time_scale == 1.0
    assert session.jaws[-1].adc == 420
    (motion,) = [m for m in session.motions if m.path is not None and m.stopped_s is None]
    during = [s.status.busy for s in session.statuses if motion.sent_s < s.time_s <= motion.begin_s + 3.0]
    assert True in during
    assert not session.statuses[-1].status.busy
    assert session.faults == ()
    assert session.failures == ()
    assert [stop.data["at_rest"] for stop in session.noted("stop")] == [True, True]
    assert session.damaged == 0
    assert len(session.stops) == sum(stop.data["stops"] for stop in session.noted("stop"))
    assert session.sent[0].text == "ECHO:0"
    assert is_log(session.file)


def test_homing_is_over_when_the_unit_says_so(session: Session, tmp_path: Path) -> None:
    last = max(line.time_s for line in session.sent if line.text.startswith("HH"))
    assert last < session.homed_s < session.motions[0].sent_s
    assert read_log(write(tmp_path / "none.jsonl")).homed_s == -np.inf
    started = {"t": 1.0, "kind": "sent", "data": "HHA:\n"}
    assert read_log(write(tmp_path / "started.jsonl", started)).homed_s == np.inf


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


def test_a_torn_or_damaged_line_is_counted_and_the_rest_is_read(
    run: LoggedRun, session: Session, tmp_path: Path
) -> None:
    data = run.log.read_bytes()
    torn = tmp_path / "torn.jsonl"
    torn.write_bytes(data[:-20])
    again = read_log(torn)
    assert (again.records, again.damaged) == (session.records - 1, 1)
    lines = data.splitlines(keepends=True)
    rows = [i for i, line in enumerate(lines) if b'"streamed"' in line or b'"read_back"' in line]
    lines[rows[0]], lines[rows[1]] = b'{"t": 1e999, "kind": "sent", "data": ""}\n', b"[" * 100_000 + b"\n"
    (tmp_path / "damaged.jsonl").write_bytes(b"".join(lines))
    again = read_log(tmp_path / "damaged.jsonl")
    assert again.damaged == 2
    assert replace(again, file=session.file, records=0, notes=(), damaged=0) == replace(
        session, records=0, notes=(), damaged=0
    )


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "line 1: is empty, so this is not a wire log"),
        (b'{"format":"a465-plan/2"}\n', 'line 1: must be the record of kind "open"'),
        (b'{"t":0,"kind":"sent","data":""}\n', 'line 1: must be the record of kind "open"'),
        (b"\xff\xd8\xff", 'line 1: must be the record of kind "open"'),
        (
            b'{"t":0,"kind":"open","time_scale":0}\n',
            "line 1: time_scale = 0.0: must be|line 1: time_scale = 0: must be",
        ),
    ],
)
def test_what_is_no_log_is_told_by_file_and_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "no.jsonl"
    path.write_bytes(content)
    with pytest.raises(FileInputError, match=rf"no\.jsonl: ({message})") as refused:
        read_log(path)
    assert refused.value.exit_code == 2
    with pytest.raises(FileInputError, match="cannot be read: "):
        read_log(tmp_path / "none")
    with pytest.raises(FileInputError, match="cannot be read: "):
        read_log(tmp_path)


TEXTS = st.one_of(
    st.text(max_size=60),
    st.builds(
        lambda name, values: f"{name}{','.join(map(str, values))}\r\n",
        st.sampled_from(
            [
                "COORDAP=",
                "COORDSPLINET:",
                "COORDMVT:",
                "COORDMV:",
                "ST=",
                "APG=",
                "\nSTOP:",
                "R:",
                "R!",
                "COORDGRP:",
            ]
        ),
        st.lists(st.integers(-(2**40), 2**40), max_size=21),
    ),
)
RECORDS = st.fixed_dictionaries(
    {"t": st.floats(), "kind": st.sampled_from(["sent", "received", "step", "open"]), "data": TEXTS}
).map(lambda r: json.dumps(r).encode())


@settings(max_examples=300, deadline=None)
@given(st.lists(st.one_of(RECORDS, st.binary(max_size=80)), max_size=30), st.booleans())
def test_random_bytes_never_crash_it(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], opened: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / f"random-{os.getpid()}.jsonl"
    head = [json.dumps(OPEN).encode()] if opened else []
    path.write_bytes(b"\n".join([*head, *lines]))
    try:
        session = read_log(path)
    except FileInputError:
        assert not opened
        return
    assert session.records + session.damaged <= 1 + 30 * 80 * 2
    times = [s.heard_s for s in session.samples]
    assert all(np.isfinite(t) for t in times)
    for before, after in pairwise(session.motions):
        assert before.sent_s is not None
        assert after.path is None or after.path.start == after.start
