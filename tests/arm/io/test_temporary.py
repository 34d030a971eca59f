"""What killed programs leave half written is removed by the next one; what somebody still writes is not."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from arm.io.storage import write_atomic
from arm.io.temporary import TemporaryFile, TemporaryFolder, remove_abandoned

WRITER = """
import sys, time
from pathlib import Path
from arm.io.temporary import TemporaryFile, TemporaryFolder

made = {"file": TemporaryFile, "folder": TemporaryFolder}[sys.argv[1]](Path(sys.argv[2]))
if sys.argv[1] == "folder":
    (made.path / "inside").write_text("half")
print(made.path.name, flush=True)
time.sleep(60)
"""


def _hidden(folder: Path) -> list[str]:
    return [p.name for p in folder.iterdir() if p.name.startswith(".")]


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_a_killed_writers_file_is_removed_and_a_running_writers_kept(tmp_path: Path, kind: str) -> None:
    command = [sys.executable, "-c", WRITER, kind, str(tmp_path / "a.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
        try:
            assert writer.stdout is not None
            name = writer.stdout.readline().strip()
            write_atomic(tmp_path / "other.json", "1")
            assert _hidden(tmp_path) == [name]
            os.kill(writer.pid, signal.SIGKILL)
            writer.wait(30.0)
            write_atomic(tmp_path / "a.json", "2")
        finally:
            writer.kill()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.json", "other.json"]


def test_only_files_with_our_name_pattern_are_removed(tmp_path: Path) -> None:
    kept = [
        ".a.json.x3kd92ka",
        "a.json.a465-0123456789ab",
        ".a465-0123456789ab",
        ".b.a465-0123456789ab.swp",
        ".netrc",
    ]
    for name in kept:
        (tmp_path / name).touch()
    (tmp_path / ".a.json.a465-0123456789ab").touch()
    (tmp_path / ".link.a465-0123456789ab").symlink_to(tmp_path / ".netrc")
    (tmp_path / ".full.a465-0123456789ab").mkdir()
    (tmp_path / ".full.a465-0123456789ab/x").touch()
    remove_abandoned(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([*kept, ".link.a465-0123456789ab"])
    remove_abandoned(tmp_path / "not there")


def test_two_of_one_program_do_not_remove_each_other(tmp_path: Path) -> None:
    with TemporaryFile(tmp_path / "a") as first, TemporaryFolder(tmp_path / "b") as second:
        first.write([b"1"])
        write_atomic(second.path / "c", "2")
        write_atomic(tmp_path / "d", "3")
        first.become(0o640)
        second.become()
    assert (tmp_path / "a").read_bytes() == b"1"
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "b/c").read_text() == "2"
    assert _hidden(tmp_path) == []


def test_unfinished_files_are_removed(tmp_path: Path) -> None:
    with TemporaryFile(tmp_path / "a") as a, TemporaryFolder(tmp_path / "b") as b:
        a.write([b"half"])
        (b.path / "inside").touch()
        assert len(_hidden(tmp_path)) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_file_removed_before_it_is_locked_is_created_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another program may look just then."""
    import fcntl

    plain, taken = fcntl.flock, []

    def late(handle: int, how: int) -> None:
        if not taken:
            taken.append(handle)
            remove_abandoned(tmp_path)
        plain(handle, how)

    monkeypatch.setattr(fcntl, "flock", late)
    with TemporaryFile(tmp_path / "a") as file:
        file.write([b"whole"])
        file.become(0o600)
    assert taken
    assert (tmp_path / "a").read_bytes() == b"whole"


def test_a_name_of_255_bytes_can_be_written(tmp_path: Path) -> None:
    write_atomic(tmp_path / ("é" * 125 + ".json"), "1")
    assert len(list(tmp_path.iterdir())) == 1
