"""The wire log keeps every byte, and says at once when it cannot."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest

from arm.errors import ExecutionStopped, InputError
from driver.line.clock import Clock
from driver.line.wire_log import WireLog


def records(path: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_every_byte_survives(tmp_path: Path) -> None:
    with WireLog(tmp_path / "log.jsonl", Clock()) as log:
        log.sent(bytes(range(256)))
        log.received(b"R!\r\n")
        log.note("plan", sha256="ab")
    opened, sent, received, note = records(tmp_path / "log.jsonl")
    assert opened["kind"] == "open"
    assert str(sent["data"]).encode("latin-1") == bytes(range(256))
    assert received["data"] == "R!\r\n"
    assert (note["kind"], note["sha256"]) == ("plan", "ab")
    assert float(str(opened["t"])) <= float(str(note["t"]))


def test_records_of_two_threads_never_mix(tmp_path: Path) -> None:
    with WireLog(tmp_path / "log.jsonl", Clock()) as log:
        writers = [
            threading.Thread(target=lambda: [log.sent(b"s" * 200) for _ in range(300)]),
            threading.Thread(target=lambda: [log.received(b"r" * 200) for _ in range(300)]),
        ]
        for writer in writers:
            writer.start()
        for writer in writers:
            writer.join()
    assert len(records(tmp_path / "log.jsonl")) == 601


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"log .*: cannot be written"):
        WireLog(tmp_path / "file" / "log.jsonl", Clock())


def test_a_full_disk_is_refused_at_once() -> None:
    with pytest.raises(InputError, match="No space left"):
        WireLog(Path("/dev/full"), Clock())


def test_a_disk_that_fills_later_stops_the_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with WireLog(tmp_path / "log.jsonl", Clock()) as log:
        log.check()
        monkeypatch.setattr("driver.line.wire_log.os.write", lambda *_: 3)
        log.sent(b"x")
        with pytest.raises(ExecutionStopped, match="no space left") as stopped:
            log.check()
        assert stopped.value.data["reason"] == "log"
