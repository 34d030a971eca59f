"""Read a wire log (JSON lines) into a `Session`.

Commands, answers, motions and samples are reconstructed from the bytes sent and received alone. The driver's notes are
added. Damaged records and samples are counted and left out.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

from arm.errors import FileInputError
from arm.io.kind import read_any, require_kind
from arm.io.storage import open_file
from driver.line.protocol import (
    Answer,
    Failed,
    MalformedAnswer,
    Other,
    Ready,
    Status,
    parse_integer,
    parse_reply,
    parse_status,
)
from driver.line.transport import LONGEST_LINE
from driver.log.motions import LoggedMotion, MotionReader
from driver.log.samples import LoggedSample, SampleReader

MOST_S = 2e9  # s, 63 years; larger times do not fit the export formats


@dataclass(frozen=True)
class LoggedLine:
    """A sent or received line without its end, and when its last byte passed, s on the log's clock.

    Attributes:
        cut: a STOP was sent before the line was complete, so the unit may have received less of it.
    """

    time_s: float
    text: str
    cut: bool = False


@dataclass(frozen=True)
class LoggedStatus:
    """A status word that differs from the one before it."""

    time_s: float
    status: Status


@dataclass(frozen=True)
class LoggedJaws:
    """Position of the gripper's axis, ADC counts."""

    time_s: float
    adc: int


@dataclass(frozen=True)
class LoggedNote:
    """An event noted by the driver (``step``, ``stop``, ``plan``, ``run`` ..), with data of JSON types."""

    time_s: float
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True)
class Session:
    """A session with a controller, read from its log. Times are controller seconds since the log was opened.

    Attributes:
        file: the log.
        time_scale: controller seconds per wall second.
        sent: lines given to the port, in order.
        motions: streamed and absolute motions, in order, with their segments.
        samples: answers to COORDAP, in order.
        statuses: status words, where they change.
        jaws: answers to the gripper's AP.
        notes: of the driver.
        ready: times of ``R!``.
        failures: times of ``FAIL!``.
        version: the unit's answer to VER, or "".
        records: number of records read.
        damaged: number of unreadable records, status words, segments and samples, and of a torn last line.
        noise: number of received lines that are not answers, echoes included.
    """

    file: Path
    time_scale: float
    sent: tuple[LoggedLine, ...]
    motions: tuple[LoggedMotion, ...]
    samples: tuple[LoggedSample, ...]
    statuses: tuple[LoggedStatus, ...]
    jaws: tuple[LoggedJaws, ...]
    notes: tuple[LoggedNote, ...]
    ready: tuple[float, ...]
    failures: tuple[float, ...]
    version: str
    records: int
    damaged: int
    noise: int

    @property
    def stops(self) -> tuple[float, ...]:
        """When STOP was sent."""
        return tuple(line.time_s for line in self.sent if line.text == "STOP:")

    @property
    def homed_s(self) -> float:
        """End of the last homing: earlier positions have another origin.

        Minus infinity if the log contains no homing, infinity if the last one did not end.
        """
        last_s = max((line.time_s for line in self.sent if line.text.startswith("HH")), default=-math.inf)
        return min((t for t in self.ready if t > last_s), default=math.inf) if last_s > -math.inf else last_s

    @property
    def faults(self) -> tuple[LoggedStatus, ...]:
        """Status words with a fault."""
        return tuple(s for s in self.statuses if s.status.fault)

    def noted(self, kind: str) -> tuple[LoggedNote, ...]:
        """Return the notes of one kind."""
        return tuple(note for note in self.notes if note.kind == kind)


def read_log(path: Path) -> Session:
    """Read a wire log. Memory is bounded by the file's size.

    Raises:
        FileInputError: the file cannot be read, or its first line is not the record that opens a log.
    """
    with _opened(path) as stream:
        return _Reader(path).read(stream)


def is_log(path: Path) -> bool:
    """Whether a file begins as a wire log does. Only its first line is read.

    Raises:
        FileInputError: the file cannot be read.
    """
    with _opened(path) as stream:
        record = parse_record(stream.readline(1000))
    return record is not None and record["kind"] == "open"


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    try:
        with open_file(path, "log") as stream:
            yield stream
    except OSError as error:
        raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error


def parse_record(line: bytes) -> dict[str, Any] | None:
    """Parse a record; None if the line is not one."""
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):  # not UTF-8, not JSON, nested too deeply
        return None
    if not isinstance(value, dict) or not isinstance(value.get("kind"), str):
        return None
    time_s = value.get("t")
    if not isinstance(time_s, int | float) or isinstance(time_s, bool) or not abs(time_s) < MOST_S:
        return None
    return value


def _bytes(record: dict[str, Any]) -> bytes | None:
    """Bytes of a ``sent`` or ``received`` record; None if it is damaged."""
    data = record.get("data")
    try:
        return data.encode("latin-1") if isinstance(data, str) else None
    except UnicodeEncodeError:
        return None


@dataclass
class _Reader:
    """Collects the content of a `Session`; a list has the name of the session's tuple."""

    path: Path
    time_scale: float = 1.0
    sent: list[LoggedLine] = field(default_factory=list)
    statuses: list[LoggedStatus] = field(default_factory=list)
    jaws: list[LoggedJaws] = field(default_factory=list)
    notes: list[LoggedNote] = field(default_factory=list)
    ready: list[float] = field(default_factory=list)
    failures: list[float] = field(default_factory=list)
    version: str = ""
    records: int = 0
    damaged: int = 0
    noise: int = 0
    unsent: bytes = b""
    unread: bytes = b""

    def read(self, stream: BinaryIO) -> Session:
        self.motions, self.samples = MotionReader(), SampleReader()
        for number, line in enumerate(stream, start=1):
            record = parse_record(line)
            if number == 1:
                self._open(record)
            elif record is None:
                self.damaged += bool(line.strip())
                continue
            elif record["kind"] == "open":
                rule = f"is two logs: the second one begins at line {number}"
                raise FileInputError(self.path, "", None, rule, "give each of them as a file of its own")
            self.records += 1
            if record is not None:
                self._take(record)
        if not self.records:
            raise FileInputError(self.path, "", None, "line 1: is empty, so this is not a wire log")
        samples = self.samples.finish()
        collected = {name: tuple(items) for name, items in vars(self).items() if isinstance(items, list)}
        return Session(
            file=self.path,
            time_scale=self.time_scale,
            motions=self.motions.finish(samples),
            samples=samples,
            version=self.version,
            records=self.records,
            damaged=self.damaged + self.samples.damaged + self.motions.damaged,
            noise=self.noise,
            **collected,
        )

    def _open(self, record: dict[str, Any] | None) -> None:
        if record is None or record["kind"] != "open":
            require_kind(self.path, read_any(self.path), "log")
            rule = 'line 1: must be the record of kind "open" that begins a wire log'
            raise FileInputError(self.path, "", None, rule)
        scale = record.get("time_scale", 1.0)
        if isinstance(scale, bool) or not isinstance(scale, int | float) or not 0.0 < scale < math.inf:
            rule = "must be controller seconds per wall second, above 0"
            raise FileInputError(self.path, "line 1: time_scale", scale, rule)
        self.time_scale = float(scale)
        self.samples.open(self.time_scale)

    def _take(self, record: dict[str, Any]) -> None:
        time_s, kind = float(record["t"]), record["kind"]
        if kind not in ("sent", "received"):
            noted = {key: value for key, value in record.items() if key not in ("t", "kind")}
            self.notes.append(LoggedNote(time_s, kind, noted))
            return
        data = _bytes(record)
        if data is None:
            self.damaged += 1
        elif kind == "sent":
            for line in self._sent_lines(time_s, data):
                self.sent.append(line)
                self.motions.sent(line.time_s, line.text, line.cut)
                self.samples.sent(line.text)
        else:
            *received, rest = (self.unread + data).split(b"\n")
            self.unread = rest if len(rest) <= LONGEST_LINE else b""
            for text in received:
                self._received(time_s, text.rstrip(b"\r").decode("latin-1"))

    def _sent_lines(self, time_s: float, data: bytes) -> Iterator[LoggedLine]:
        cut = data.startswith(b"\nSTOP")  # the link has ended a partial line
        *lines, self.unsent = (self.unsent + data).split(b"\n")
        for number, line in enumerate(lines):
            if line:
                yield LoggedLine(time_s, line.decode("latin-1"), cut and number == 0)

    def _received(self, time_s: float, text: str) -> None:
        match parse_reply(text):
            case Answer("COORDAP", value):  # answers to other queries than these carry nothing for a session
                self.samples.answer(time_s, value)
            case Answer("ST", value):
                self._status(time_s, value)
            case Answer("VER", value):
                self.version = value
            case Answer(key, value) if key in ("APG", "APH"):
                self._jaws(time_s, value)
            case Ready(axis):
                self.ready += [] if axis else [time_s]
                self.motions.ready(time_s, axis)
            case Failed():
                self.failures.append(time_s)
            case Other():
                self.noise += bool(text)

    def _status(self, time_s: float, value: str) -> None:
        try:
            status = parse_status(value)
        except MalformedAnswer:
            self.damaged += 1
            return
        if not self.statuses or self.statuses[-1].status != status:
            self.statuses.append(LoggedStatus(time_s, status))

    def _jaws(self, time_s: float, value: str) -> None:
        try:
            self.jaws.append(LoggedJaws(time_s, parse_integer(value)))
        except MalformedAnswer:
            self.damaged += 1
