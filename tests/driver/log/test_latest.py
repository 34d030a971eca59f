"""The end of a log that is still being written tells where the arm is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import driver.log.latest
from arm.errors import FileInputError
from driver.line.clock import Clock
from driver.line.protocol import Status
from driver.line.wire_log import WireLog
from driver.log.latest import Latest, read_latest


def _log(path: Path, *received: str) -> None:
    with WireLog(path, Clock()) as log:
        log.note("run", unit="crs97", joint_offsets_rad=[0.0] * 6)
        log.note("step", index=0, name="to-start")
        for text in received:
            log.received(text.encode())
        log.note("step", index=1, name="fetch")


def test_the_last_whole_answers_count(tmp_path: Path) -> None:
    file = tmp_path / "wire.jsonl"
    answers = (
        "ST=16\r\nCOORDAP=1,2,3,1,2,3,4,5,6\r\n",
        "COORDAP=1,2,3,7,8,9,",
        "10,11,12\r\nAPG=840\r\nAPH=0\r\nST=0\r\n",
    )
    _log(file, *answers, "COORDAP=1,2,3,4\r\nST=x\r\n", "COORDAP=9,9,9,9,9,9,9,9,9")
    found = read_latest(file)
    assert found.counts == (7, 8, 9, 10, 11, 12)
    assert (found.status, found.jaws, found.step) == (Status(0), 840, "fetch")
    assert found.unit["unit"] == "crs97"
    assert 0.0 <= found.age_s < 600.0


def test_only_the_beginning_and_the_end_are_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "wire.jsonl"
    _log(file, *(f"COORDAP=1,2,3,{k},0,0,0,0,0\r\n" for k in range(400)))
    monkeypatch.setattr(driver.log.latest, "BEGIN_BYTES", 300)
    monkeypatch.setattr(driver.log.latest, "END_BYTES", 1000)
    found = read_latest(file)
    assert found.counts == (399, 0, 0, 0, 0, 0)
    assert found.unit["unit"] == "crs97"


def test_damaged_records_are_skipped(tmp_path: Path) -> None:
    file = tmp_path / "wire.jsonl"
    file.write_bytes(
        b'\xff{"t": 0\n[1]\n' + json.dumps({"t": 0, "kind": "received", "data": 5}).encode() + b"\n"
    )
    found = read_latest(file)
    assert found == Latest(age_s=found.age_s)
    with pytest.raises(FileInputError, match="cannot be read"):
        read_latest(tmp_path / "none")
