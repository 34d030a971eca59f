"""The wire log: every byte of a link and every event of the driver, with time stamps, as JSON lines.

Each record is one write to a file opened for appending, so records of two threads never mix and a crash loses no
written record.
"""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

from arm.errors import ExecutionStopped, InputError
from arm.io.storage import unmade
from driver.line.clock import Clock


class WireLog:
    """A log file of one session with a controller.

    Bytes are stored as Latin-1 text, one character per byte, so that any byte survives and ASCII stays readable. Kinds
    of record: ``open``, ``sent``, ``received``, and those of `note`.

    Args:
        path: the file; an existing one is replaced.
        clock: of the time stamps, controller seconds.

    Raises:
        InputError: the file cannot be created or the disk is full.
    """

    def __init__(self, path: Path, clock: Clock) -> None:
        self.path = path
        self._clock = clock
        self._failure: OSError | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o666)
            self.note("open", time_scale=clock.time_scale)
            if self._failure is not None:
                os.close(self._file)
                raise self._failure
        except OSError as error:
            raise InputError(
                f"log {path}: cannot be written: {unmade(path, error)}", file=str(path)
            ) from error

    def sent(self, data: bytes) -> None:
        """Record bytes given to the port."""
        self._write("sent", {"data": data.decode("latin-1")})

    def received(self, data: bytes) -> None:
        """Record bytes taken from the port."""
        self._write("received", {"data": data.decode("latin-1")})

    def note(self, kind: str, **data: Any) -> None:
        """Record an event of the driver, such as a step or a stop, with data of JSON types."""
        self._write(kind, data)

    @property
    def failed(self) -> bool:
        """Whether a record was lost."""
        return self._failure is not None

    def check(self) -> None:
        """Refuse to continue with a log that has lost a record.

        Raises:
            ExecutionStopped: a record could not be written.
        """
        if self._failure is not None:
            why = f"log {self.path}: cannot be written any more: {self._failure.strerror}"
            raise ExecutionStopped(why, file=str(self.path), reason="log")

    def close(self) -> None:
        """Close the file. Later records are dropped."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> WireLog:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, kind: str, data: dict[str, Any]) -> None:
        if self._failure is not None or self._file < 0:
            return
        record = json.dumps({"t": round(self._clock.now(), 6), "kind": kind, **data}, separators=(",", ":"))
        line = record.encode() + b"\n"
        try:
            # A short write happens only when the disk is full; it leaves a torn last line.
            if os.write(self._file, line) != len(line):
                self._failure = OSError(errno.ENOSPC, "no space left on the device")
        except OSError as error:
            self._failure = error
