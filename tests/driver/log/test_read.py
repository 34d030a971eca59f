"""A wire log read back: what was sent, where the arm was, on the unit's clock; and damage that is counted."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arm.errors import FileInputError
from driver.log.read import Session, is_log, read_log
from wire.logged_session import LoggedRun
from wire.written_log import OPEN, write


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


def test_two_logs_in_one_file_are_told_with_the_line(tmp_path: Path) -> None:
    one = write(tmp_path / "one.jsonl", {"t": 1.0, "kind": "sent", "data": "ST:\n"}).read_text()
    (tmp_path / "both.jsonl").write_text(one + one)
    with pytest.raises(FileInputError, match=r"both\.jsonl: is two logs: the second one begins at line 3 "):
        read_log(tmp_path / "both.jsonl")


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
    with pytest.raises(FileInputError, match="is a folder, must be a file"):
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


@settings(max_examples=100, deadline=None)
@given(st.lists(st.one_of(RECORDS, st.binary(max_size=80)), max_size=30), st.booleans())
def test_random_bytes_never_crash_it(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], opened: bool
) -> None:
    path = tmp_path_factory.getbasetemp() / f"random-{os.getpid()}.jsonl"
    head = [json.dumps(OPEN).encode()] if opened else []
    path.write_bytes(b"\n".join([*head, *lines]))
    again = any(b'"kind": "open"' in line for line in lines)  # which may be two logs, and is refused then
    try:
        session = read_log(path)
    except FileInputError:
        assert not opened or again
        return
    assert session.records + session.damaged <= 1 + 30 * 80 * 2
    times = [s.heard_s for s in session.samples]
    assert all(np.isfinite(t) for t in times)
    for before, after in pairwise(session.motions):
        assert before.sent_s is not None
        assert after.path is None or after.path.start == after.start
