"""What the bench of studies asks of the processes that compute: memory, time, and which chunks they hold."""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Sequence
from pathlib import Path


def cpu_s(pid: int) -> float:
    """Seconds of CPU of a process, its children left out."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def memory_mb(pid: int) -> float:
    """Most memory that a process has had, MB."""
    with contextlib.suppress(OSError):
        found = re.search(r"VmHWM:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text())
        return int(found[1]) / 1e3 if found else 0.0
    return 0.0


def children(pid: int) -> list[int]:
    """The processes that compute."""
    with contextlib.suppress(OSError):
        threads = Path(f"/proc/{pid}/task").glob("*/children")
        found = (int(child) for thread in threads for child in thread.read_text().split())
        return [one for one in found if "spawn_main" in Path(f"/proc/{one}/cmdline").read_text()]
    return []


def abandoned(folder: Path) -> set[str]:
    """Chunks that were begun, are not finished, and are held by no process."""
    return {
        lock.name
        for lock in (folder / "chunks").glob("*.lock")
        if not _held(lock) and not lock.with_suffix("").is_file()
    }


def _held(lock: Path) -> bool:
    with contextlib.suppress(FileNotFoundError), lock.open() as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def wait_for_end(processes: Sequence[int]) -> None:
    """Wait until none of these processes computes, for a minute at most."""
    deadline = time.monotonic() + 60.0
    while any(_lives(pid) for pid in processes) and time.monotonic() < deadline:
        time.sleep(0.01)


def _lives(pid: int) -> bool:
    """Whether a process computes; one that has ended, and that its parent has not asked for, does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False
