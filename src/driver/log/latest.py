"""The latest state in the wire log of a session that is still running. Only its beginning and its end are read."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arm.errors import FileInputError
from arm.io.storage import open_file
from driver.line.protocol import (
    Answer,
    MalformedAnswer,
    Status,
    parse_integer,
    parse_position,
    parse_reply,
    parse_status,
)
from driver.log.read import parse_record

AXES = 6
BEGIN_BYTES, END_BYTES = 20_000, 200_000  # the latter holds several seconds of a streamed motion


@dataclass
class Latest:
    """What the latest records of a log say; None or "" where they say nothing.

    Attributes:
        unit: record ``run``: unit, and joint offsets if it is calibrated.
        step: name of the latest step of a plan.
        counts: latest position (6,).
        status: latest status.
        jaws: latest position of the jaws, ADC counts.
        age_s: wall time since the latest record.
    """

    unit: dict[str, Any] = field(default_factory=dict)
    step: str = ""
    counts: tuple[int, ...] | None = None
    status: Status | None = None
    jaws: int | None = None
    age_s: float = 0.0


def read_latest(path: Path) -> Latest:
    """Read the latest state from a wire log. Damaged records are skipped.

    Raises:
        FileInputError: the file cannot be read.
    """
    found = Latest()
    try:
        with open_file(path, "log") as stream:
            size = os.fstat(stream.fileno()).st_size
            found.age_s = max(time.time() - os.fstat(stream.fileno()).st_mtime, 0.0)
            begin = stream.read(BEGIN_BYTES)
            stream.seek(max(size - END_BYTES, 0))
            end = stream.read(END_BYTES)
    except OSError as error:
        raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error
    for line in begin.splitlines():
        record = parse_record(line)
        if record is not None and record["kind"] == "run":
            found.unit = record
    received = ""
    for line in end.splitlines():
        record = parse_record(line)
        if record is not None and record["kind"] == "step":
            found.step = str(record.get("name", ""))
        elif record is not None and record["kind"] == "received":
            received += str(record.get("data", ""))
    for text in received.split("\n")[:-1]:  # the last line may be incomplete
        with suppress(MalformedAnswer):
            _take(found, text.rstrip("\r"))
    return found


def _take(found: Latest, text: str) -> None:
    match parse_reply(text):
        case Answer("COORDAP", value):
            found.counts = parse_position(value, AXES).counts
        case Answer("ST", value):
            found.status = parse_status(value)
        case Answer(key, value) if key in ("APG", "APH"):
            adc = parse_integer(value)
            found.jaws = adc or found.jaws  # an axis without a gripper reads 0
