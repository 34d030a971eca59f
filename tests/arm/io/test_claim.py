"""A claim names its holder while that lives, and only then."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import arm.io.claim
from arm.io.claim import Claim, Claimed, Holder, holder_of

HOLDS = """
import sys, time
from pathlib import Path
import arm.io.claim
arm.io.claim.FOLDER = Path(sys.argv[1])
claim = arm.io.claim.Claim("port P", Path("runs/x-1/wire.jsonl"))
print("held", flush=True)
time.sleep(600)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(arm.io.claim, "FOLDER", tmp_path / "claims")
    return tmp_path / "claims"


def test_a_holder_is_named_until_it_lets_go() -> None:
    assert holder_of("port P") is None
    with Claim("port P", Path("runs/x-1/wire.jsonl")):
        found = holder_of("port P")
        assert found is not None
        assert found.pid == os.getpid()
        assert found.folder == str(Path.cwd() / "runs/x-1")
        assert f"process {os.getpid()}" in found.describe()
        assert holder_of("port Q") is None
        with pytest.raises(Claimed, match="port P: is in use by another program: ") as refused:
            Claim("port P")
        assert refused.value.holder == found
    assert holder_of("port P") is None
    Claim("port P").release()


def test_a_holder_that_is_killed_holds_nothing(folder: Path) -> None:
    command = [sys.executable, "-c", HOLDS, str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "held\n"
        found = holder_of("port P")
        assert found is not None
        assert found.pid == other.pid
        with pytest.raises(Claimed):
            Claim("port P")
        other.send_signal(signal.SIGKILL)
    assert holder_of("port P") is None
    with Claim("port P"):
        pass


def test_what_a_dead_program_left_is_not_taken_for_the_one_that_begins(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arm.io.claim, "WAIT_S", 0.1)
    with subprocess.Popen([sys.executable, "-c", "pass"]) as dead:
        pass
    for pid in (dead.pid, os.getppid()):  # or what another container calls by that number
        with Claim("port P"):
            (file,) = folder.iterdir()
            file.write_text(file.read_text().replace(f'"pid": {os.getpid()}', f'"pid": {pid}'))
            assert holder_of("port P") is None


def test_a_reader_does_not_keep_a_claim_from_being_made() -> None:
    """It holds the lock for a moment."""
    stop, wrong = threading.Event(), []

    def read() -> None:
        while not stop.is_set():
            found = holder_of("port P")
            if found is not None and found.pid != os.getpid():
                wrong.append(found)

    threads = [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    over = time.monotonic() + 0.3
    try:
        while time.monotonic() < over:
            Claim("port P").release()
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert wrong == []


def test_a_claim_waits_for_a_reader_that_holds_the_lock(folder: Path) -> None:
    Claim("port P").release()
    (file,) = folder.iterdir()
    reader = os.open(file, os.O_RDONLY)
    fcntl.flock(reader, fcntl.LOCK_SH)
    threading.Timer(0.1, os.close, [reader]).start()
    with Claim("port P"):
        pass


def test_a_claim_may_wait_for_another() -> None:
    first = Claim("port P")
    threading.Timer(0.1, first.release).start()
    with Claim("port P", wait_s=30.0):
        pass


def test_a_brief_holder_is_waited_for_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    first = Claim("port P", brief=True)
    threading.Timer(0.1, first.release).start()
    with Claim("port P"):
        begun = time.monotonic()
        with pytest.raises(Claimed):
            Claim("port P")
        assert time.monotonic() - begun < 0.5 * arm.io.claim.BRIEF_S
    monkeypatch.setattr(arm.io.claim, "BRIEF_S", 0.1)
    with Claim("port P", brief=True), pytest.raises(Claimed):  # one that does not let go
        Claim("port P")


def test_no_password_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/bin/a465", "run", "--camera", "video:rtsp://me:secret@host/1"])
    with Claim("port P"):
        found = holder_of("port P")
    assert found is not None
    assert found.command.startswith("a465 run --camera")
    assert "secret" not in found.command


def test_a_folder_of_somebody_else_is_not_used(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    with Claim("port P"):
        assert holder_of("port P") is None
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_who_has_no_log_has_no_folder() -> None:
    assert Holder(1, "a", "now").folder == ""
    assert Holder(1, "a", "now").describe() == "a (process 1, since now)"
