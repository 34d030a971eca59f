"""Hidden temporary files and folders beside what is written, and the removal of those that a killed program left.

Each is locked (flock) by the program that writes it. The kernel gives a lock up when its program ends, however that
ends, also by ``kill -9`` or a power cut; so what is named as ours and is not locked belongs to nobody. That holds
across containers and reboots, where a process number would name somebody else.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import secrets
import shutil
from abc import ABC, abstractmethod
from pathlib import Path

_OURS = re.compile(r"\..+\.a465-[0-9a-f]{12}", re.DOTALL)
_TRIES = 20


def _name(path: Path) -> Path:
    """A new hidden name beside `path`; the part of its name that fits a name of 255 bytes."""
    begins = os.fsdecode(os.fsencode(path.name)[:200])
    return path.with_name(f".{begins}.a465-{secrets.token_hex(6)}")


def _lock(handle: int) -> None:
    with contextlib.suppress(OSError):  # a file system without locks: nothing there is ever removed either
        fcntl.flock(handle, fcntl.LOCK_EX)


class _Temporary(ABC):
    """Holds the lock of `path` until `close`."""

    path: Path
    _handle: int

    @abstractmethod
    def _make(self, beside: Path) -> tuple[Path, int]:
        """Make it in that folder, under a name of our own; its path and an open handle of it."""

    def __init__(self, target: Path) -> None:
        """
        Args:
            target: what the file or folder becomes; its folder must be there.

        Raises:
            OSError: nothing can be made there.
        """
        remove_abandoned(target.parent)
        self._target = target
        for _ in range(_TRIES):
            self.path, self._handle = self._make(_name(target))
            _lock(self._handle)
            # between making and locking it, somebody else may have taken it for abandoned
            if os.fstat(self._handle).st_nlink and self.path.exists():
                return
            os.close(self._handle)
        raise OSError(11, f"a temporary file beside {target} is removed again and again")

    def close(self) -> None:
        """Give up the lock."""
        os.close(self._handle)


class TemporaryFile(_Temporary):
    """A file that gets its name once it is whole; removed if it does not.

    Used as a context manager around `write` and `become`.
    """

    def _make(self, beside: Path) -> tuple[Path, int]:
        return beside, os.open(beside, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)

    def write(self, content: bytes) -> None:
        """Write and sync."""
        with os.fdopen(os.dup(self._handle), "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())

    def become(self, mode: int) -> None:
        """Replace the target by this file, which gets the mode."""
        os.chmod(self.path, mode)
        os.replace(self.path, self._target)

    def __enter__(self) -> TemporaryFile:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(FileNotFoundError):
            self.path.unlink()
        self.close()


class TemporaryFolder(_Temporary):
    """A folder that gets its name once it is whole; removed with all in it if it does not."""

    def _make(self, beside: Path) -> tuple[Path, int]:
        beside.mkdir(mode=0o700)
        return beside, os.open(beside, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)

    def become(self) -> None:
        """Take the target's name; an empty folder there is replaced, one that was filled meanwhile is not."""
        self.path.chmod(mode_of_new(0o777))
        self.path.rename(self._target)

    def __enter__(self) -> TemporaryFolder:
        return self

    def __exit__(self, *_: object) -> None:
        shutil.rmtree(self.path, ignore_errors=True)  # not there any more if all went well
        self.close()


def mode_of_new(mode: int = 0o666) -> int:
    """The mode of a new file, or of a folder if `mode` is 0o777."""
    umask = os.umask(0)
    os.umask(umask)
    return mode & ~umask


def remove_abandoned(folder: Path) -> None:
    """Remove what programs of this project began in a folder and did not finish, if they run no more."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _OURS.fullmatch(entry.name) and not entry.is_symlink():
                with contextlib.suppress(OSError):
                    _remove(Path(entry.path), entry.is_dir(follow_symlinks=False))


def _remove(path: Path, is_folder: bool) -> None:
    """Remove it if nobody holds its lock.

    Raises:
        OSError: somebody does, it is gone, or may not be removed.
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
