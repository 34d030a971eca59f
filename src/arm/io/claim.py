"""Who uses a port or a file: a lock with the name of its holder, which other programs of the same user can read.

The lock (flock) is on a small file in the system's temporary folder. The kernel releases it when the holder ends in any
way, so a holder that is named is alive, and its process ID is right. Where no such file can be made, nothing is claimed
and nobody is named.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import shlex
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path

from arm.credentials import hide_credentials
from arm.errors import InputError

FOLDER = Path(tempfile.gettempdir()) / f"a465-{os.getuid()}"
WAIT_S = 1.0  # for a holder that is about to say who it is, or for a reader to let go
BRIEF_S = 5.0  # for a holder that only asks something
_POLL_S = 0.01
_LONGEST = 100_000  # bytes


@dataclass(frozen=True)
class Holder:
    """A program that has claimed something.

    Attributes:
        pid: its process.
        command: its command line.
        since: when it made the claim, ISO 8601.
        log: its wire log, an absolute path, or "".
        brief: whether it lets go by itself at once, so that others wait for it.
    """

    pid: int
    command: str
    since: str
    log: str = ""
    brief: bool = False

    @property
    def folder(self) -> str:
        """Folder of its run, or ""."""
        return str(Path(self.log).parent) if self.log else ""

    def describe(self) -> str:
        """Name it in one phrase."""
        where = f", its log is {self.log}" if self.log else ""
        return f"{self.command} (process {self.pid}, since {self.since}{where})"


class Claimed(InputError):
    """Another program holds what was to be claimed. `holder` is that program, None if it is not named."""

    def __init__(self, what: str, holder: Holder | None) -> None:
        named = "" if holder is None else f": {holder.describe()}"
        super().__init__(
            f"{what}: is in use by another program{named}", holder=None if holder is None else asdict(holder)
        )
        self.holder = holder


class Claim:
    """A claim, from its creation until `release` or the end of this program. A context manager.

    Args:
        what: what is claimed; two names of the same thing must be made equal first.
        log: wire log of this program.
        wait_s: wall time to wait for the holder of another claim to let go; at least `BRIEF_S` for a brief one.
        brief: see `Holder`.

    Raises:
        Claimed: another claim on it holds.
    """

    def __init__(self, what: str, log: Path | None = None, wait_s: float = 0.0, brief: bool = False) -> None:
        self._handle = _open(what, os.O_RDWR | os.O_CREAT)
        if self._handle < 0:
            return
        begun = time.monotonic()
        while not _locked(self._handle, fcntl.LOCK_EX):
            holder = holder_of(what)
            patience = WAIT_S if holder is None else BRIEF_S if holder.brief else 0.0
            if time.monotonic() > begun + max(wait_s, patience):
                os.close(self._handle)
                raise Claimed(what, holder)
            time.sleep(_POLL_S)
        since = datetime.now().astimezone().isoformat(timespec="seconds")
        path = "" if log is None else str(log.absolute())
        command = hide_credentials(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]))
        holder = Holder(os.getpid(), command, since, path, brief)
        with contextlib.suppress(OSError):  # a full disk: the lock holds, but nobody is named
            os.ftruncate(self._handle, 0)
            os.pwrite(self._handle, json.dumps(asdict(holder)).encode(), 0)

    def release(self) -> None:
        """Give it up; nothing happens the second time."""
        handle, self._handle = self._handle, -1
        if handle >= 0:
            with contextlib.suppress(OSError):
                os.ftruncate(handle, 0)
            os.close(handle)

    def __enter__(self) -> Claim:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


def holder_of(what: str) -> Holder | None:
    """Return the program that has claimed something; None if none of this user's has.

    Waits up to `WAIT_S` for one that has just begun.
    """
    handle = _open(what, os.O_RDONLY)
    if handle < 0:
        return None
    try:
        for _ in _until(time.monotonic() + WAIT_S):
            if _locked(handle, fcntl.LOCK_SH):
                return None
            with contextlib.suppress(ValueError, TypeError, OSError):
                holder = Holder(**json.loads(os.pread(handle, _LONGEST, 0)))
                # else it was killed and a new one is about to write its name, or its ID is of another container
                if _has_open(holder.pid, handle):
                    return holder
        return None
    finally:
        os.close(handle)


def _has_open(pid: int, handle: int) -> bool:
    """Whether a process has the file of a handle open.

    Raises:
        OSError: there is no such process of this user.
    """
    wanted = os.fstat(handle)
    for name in os.listdir(f"/proc/{pid}/fd"):
        with contextlib.suppress(OSError):  # closed meanwhile
            if os.path.samestat(os.stat(f"/proc/{pid}/fd/{name}"), wanted):
                return True
    return False


def _until(over: float) -> Iterator[None]:
    while True:
        yield
        if time.monotonic() > over:
            return
        time.sleep(_POLL_S)


def _locked(handle: int, kind: int) -> bool:
    try:
        fcntl.flock(handle, kind | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _open(what: str, flags: int) -> int:
    """Open the file of a claim in a folder that only this user can write; -1 if that cannot be done."""
    name = hashlib.sha256(what.encode()).hexdigest()[:16]
    with contextlib.suppress(OSError):
        FOLDER.mkdir(mode=0o700, exist_ok=True)
        found = FOLDER.lstat()
        if stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid():
            return os.open(FOLDER / f"{name}.json", flags | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    return -1
