"""Hidden temporary files and folders beside their targets, and removal of those that a killed program left.

The program that writes one holds its lock (flock). The kernel releases the lock when the program ends in any way,
including ``kill -9`` and power cuts, so a temporary file without a lock is abandoned. This works across
containers and reboots, unlike process IDs.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import shutil
from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path

_OURS = re.compile(r"\..+\.a465-[0-9a-f]{12}", re.DOTALL)
_TRIES = 20


def _name(path: Path) -> Path:
    """Return a new hidden name beside `path`, shortened to fit 255 bytes."""
    begins = os.fsdecode(os.fsencode(path.name)[:200])
    return path.with_name(f".{begins}.a465-{secrets.token_hex(6)}")


def _lock(handle: int) -> None:
    with contextlib.suppress(OSError):  # on a file system without locks, nothing is ever removed
        fcntl.flock(handle, fcntl.LOCK_EX)


class _Temporary(ABC):
    """Holds the lock of `path` until `close`."""

    path: Path
    _handle: int

    @abstractmethod
    def _make(self, beside: Path) -> tuple[Path, int]:
        """Create the file or folder `beside`; return its path and an open handle."""

    def __init__(self, target: Path, tidy: bool = True) -> None:
        """
        Args:
            target: what the file or folder becomes; its folder must be there.
            tidy: first remove what killed programs left there.

        Raises:
            OSError: the file or folder cannot be created.
        """
        if tidy:
            remove_abandoned(target.parent)
        self._target = target
        for _ in range(_TRIES):
            self.path, self._handle = self._make(_name(target))
            _lock(self._handle)
            # another program may have removed it as abandoned before it was locked
            if os.fstat(self._handle).st_nlink and self.path.exists():
                return
            os.close(self._handle)
        raise OSError(11, f"a temporary file beside {target} keeps being removed")

    def close(self) -> None:
        """Release the lock."""
        os.close(self._handle)


class TemporaryFile(_Temporary):
    """A file that gets its final name once complete, and is removed otherwise.

    A context manager around `write` and `become`.
    """

    def _make(self, beside: Path) -> tuple[Path, int]:
        return beside, os.open(beside, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)

    def write(self, parts: Iterable[bytes]) -> None:
        """Write one part after the other, and sync."""
        with os.fdopen(os.dup(self._handle), "wb") as stream:
            stream.writelines(parts)
            stream.flush()
            os.fsync(stream.fileno())

    def become(self, mode: int) -> None:
        """Set the mode and replace the target with this file."""
        os.chmod(self.path, mode)
        os.replace(self.path, self._target)

    def __enter__(self) -> TemporaryFile:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(FileNotFoundError):
            self.path.unlink()
        self.close()


class TemporaryFolder(_Temporary):
    """A folder that gets its final name once complete, and is removed with its contents otherwise."""

    def _make(self, beside: Path) -> tuple[Path, int]:
        beside.mkdir(mode=0o700)
        return beside, os.open(beside, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)

    def become(self) -> None:
        """Rename to the target; an empty folder there is replaced, one with contents is not."""
        self.path.chmod(mode_of_new(0o777))
        self.path.rename(self._target)

    def __enter__(self) -> TemporaryFolder:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)  # already renamed if all went well
        self.close()


def mode_of_new(mode: int = 0o666) -> int:
    """Return the mode of a new file, or of a folder if `mode` is 0o777."""
    umask = os.umask(0)
    os.umask(umask)
    return mode & ~umask


def remove_abandoned(folder: Path) -> None:
    """Remove unfinished files and folders of a465 programs that no longer run."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _OURS.fullmatch(entry.name) and not entry.is_symlink():
                with contextlib.suppress(OSError):
                    _remove(Path(entry.path), entry.is_dir(follow_symlinks=False))


def _remove(path: Path, is_folder: bool) -> None:
    """Remove a file or folder if its lock is free.

    Raises:
        OSError: it is locked, gone, or must not be removed.
    """
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if is_folder:
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink()
    finally:
        os.close(handle)
