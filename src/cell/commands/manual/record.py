"""``a465 record``: ask an unknown unit, keep every byte in a file, and compare it with what the code assumes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from arm.controller.unit import UNITS, load_unit
from arm.errors import A465Error, InputError
from arm.io.outputs import keep_apart
from arm.io.storage import write_atomic
from cell.console import WIDTH, Console
from cell.doctor.devices import FIRMWARE
from cell.session.ports import PortAndPlace, choose_port
from driver.record.assumptions import Row, compare
from driver.record.take import Recorder
from driver.record.tape import RECEIVED
from driver.record.unit_record import UnitRecord, read_unit_record

SECONDS, MOST_S = 60.0, 3600.0  # of readings at rest
QUESTIONS_S = 20.0  # approximate time of all else, for the progress bar
SAVE_S = 5.0  # wall time between two writes of the file
_HEADER = ("what", "assumed", "found", "agrees")
_VERDICTS = {True: "yes", False: "NO", None: "not known"}


def record_step(given: PortAndPlace, output: Path, seconds: float, console: Console) -> dict[str, Any]:
    """Record the unit on a port to a new file, and compare as `compare_step` does. Nothing moves; only the echo is set.

    Args:
        given: port of the controller, or a cell file that names it.
        output: file to write; it is written again and again meanwhile, each time whole.
        seconds: how long the counts are read at rest.
        console: output.

    Raises:
        InputError: a value is wrong, the file exists, the port cannot be opened, or no unit answers there.
        ExecutionStopped: the unit stops answering, or the port is lost.
    """
    if not 1.0 <= seconds <= MOST_S:
        raise InputError(f"--seconds = {seconds:g}: must be from 1 to {MOST_S:g}", seconds=seconds)
    if output.exists():
        raise InputError(
            f"{output}: exists, and a recording replaces nothing; give another file", file=str(output)
        )
    keep_apart(output, kind="unit record")
    url = choose_port(given.port, given.place, console)
    saver = _Saver(output, seconds, console)
    recorder = Recorder(url, FIRMWARE, seconds, progress=saver)
    try:
        with console.doing("recording"):
            record = recorder.run()
    except A465Error as error:
        saver.save(recorder.record())
        raise type(error)(f"{error} (what came: {output})", **{**error.data, "file": str(output)}) from error
    except BaseException:
        saver.save(recorder.record())
        console.say(f"what came: {output}")
        raise
    saver.save(record)
    console.say("only questions were sent; the echo was switched on and off, and is as it was found")
    console.say(f"{output} names neither this computer nor its devices: send it to the maintainers of a465")
    return _told(output, record, console)


def compare_step(file: Path, console: Console) -> dict[str, Any]:
    """Print what a recording says of each assumption; return it as JSON types. No port is opened.

    Args:
        file: as written by `record_step`.
        console: output.

    Raises:
        FileInputError: the file cannot be read.
    """
    return _told(file, read_unit_record(file), console)


class _Saver:
    """Shows the progress, and writes the file at most every `SAVE_S`."""

    def __init__(self, output: Path, seconds: float, console: Console) -> None:
        self._output, self._console = output, console
        self._whole_s = seconds + QUESTIONS_S
        self._saved = time.monotonic()

    def __call__(self, step: str, record: UnitRecord) -> None:
        taken_s = record.events[-1].time_s if record.events else 0.0
        self._console.progress(step, taken_s / self._whole_s)
        if time.monotonic() - self._saved >= SAVE_S:
            self.save(record)

    def save(self, record: UnitRecord) -> None:
        write_atomic(self._output, record.to_json())
        self._saved = time.monotonic()


def _told(file: Path, record: UnitRecord, console: Console) -> dict[str, Any]:
    rows = compare(record, load_unit(UNITS[0]))
    count = sum(len(event.data) for event in record.events if event.kind == RECEIVED)
    taken_s = record.events[-1].time_s if record.events else 0.0
    console.say(f"{file}: {count} bytes received in {taken_s:.0f} s; {record.ended}")
    console.table(_HEADER, [(r.name, r.assumed, r.found, _VERDICTS[r.agrees]) for r in rows], WIDTH)
    for row in rows:
        if row.agrees is not True:
            console.say(f"{row.name}: {row.matters}")
    console.say(", ".join(f"{sum(r.agrees is v for r in rows)} {word}" for v, word in _VERDICTS.items()))
    return {
        "file": str(file),
        "ended": str(record.ended),
        "seconds": round(taken_s, 3),
        "bytes_received": count,
        "differing": _names(rows, False),
        "not_known": _names(rows, None),
        "assumptions": [
            {"name": r.name, "assumed": r.assumed, "found": r.found, "agrees": r.agrees, "matters": r.matters}
            for r in rows
        ],
    }


def _names(rows: tuple[Row, ...], verdict: bool | None) -> list[str]:
    return [row.name for row in rows if row.agrees is verdict]
