"""The chunks of a study. Each finished one is a file of its own, so nothing that was computed is computed again.

The name of the file is a hash of everything that the chunk depends on: what the study asks, its files, the program, and
which points it has. Whoever computes a chunk holds a lock meanwhile, so that two who are at the same study share it.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import canonical_json, sha256, write_atomic
from arm.io.temporary import remove_abandoned
from cell.files.study import Study
from cell.study.question.scratch import Bundle

FOLDER = "chunks"


@dataclass(frozen=True)
class Chunk:
    """Some points of a study that are computed together.

    Attributes:
        number: from 0.
        first, count: its points.
        name: of its file.
    """

    number: int
    first: int
    count: int
    name: str


def chunks_of(study: Study, bundle: Bundle) -> list[Chunk]:
    """Return the chunks of a study, in the order of their points."""
    of_all = sha256(canonical_json([study.to_json(), bundle.digest]))
    found = []
    for number, first in enumerate(range(0, study.count, study.chunk)):
        count = min(study.chunk, study.count - first)
        name = sha256(f"{of_all} {first} {count}")[:32] + ".csv"
        found.append(Chunk(number, first, count, name))
    return found


class Store:
    """The folder of a study's finished chunks.

    Args:
        folder: of the study.
        tidy: remove what killed programs left. It lists the whole folder, so not for each chunk.

    Raises:
        InputError: it cannot be made.
    """

    def __init__(self, folder: Path, tidy: bool = True) -> None:
        self.folder = folder / FOLDER
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if tidy:
                remove_abandoned(self.folder)
                for lock in self.folder.glob("*.lock"):  # of one that was killed when it had finished
                    if lock.with_suffix("").is_file():
                        lock.unlink(missing_ok=True)
        except OSError as error:
            why = f"{self.folder}: cannot be made: {error.strerror}"
            raise InputError(why, file=str(self.folder)) from error

    def has(self, chunk: Chunk) -> bool:
        """Whether a chunk is finished."""
        return (self.folder / chunk.name).is_file()

    def write(self, chunk: Chunk, table: str) -> None:
        """Write a finished chunk, whole or not at all."""
        write_atomic(self.folder / chunk.name, table, tidy=False)

    def read(self, chunk: Chunk) -> str:
        """Return a finished chunk."""
        return (self.folder / chunk.name).read_bytes().decode()

    @contextmanager
    def claimed(self, chunk: Chunk) -> Iterator[bool]:
        """Hold a chunk inside the block; False: somebody else is at it.

        The kernel releases the lock when its process dies.
        """
        path = self.folder / f"{chunk.name}.lock"
        try:
            handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            why = f"{path}: cannot be written: {error.strerror}"
            raise InputError(why, file=str(path)) from error
        mine = _locked(handle)
        try:
            yield mine
        finally:
            if mine:
                path.unlink(missing_ok=True)
            os.close(handle)


def _locked(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        pass  # a file system without locks: at worst, two compute the same
    return True
