"""Options of every calibration command: the files that it writes, and the limit of its verdict."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np

from arm.errors import InputError
from arm.io.outputs import keep_apart, page_fault
from arm.io.storage import open_file, write_atomic
from cell.console import Console
from vision.camera.frame_source import IMAGE_SUFFIXES

OUTPUT, REPORT = "--output", "--report"
_HEAD = 4096  # bytes of a file that identify its content


def option_error(name: str, value: object, rule: str) -> InputError:
    """Return the error of an option with a wrong value."""
    shown = f"{value:g}" if isinstance(value, float) else value
    return InputError(f"{name} {shown}: {rule}", option=name, value=value)


def _file_error(option: str, path: Path, rule: str) -> InputError:
    return InputError(f"{option} {path}: {rule}", option=option, path=str(path))


def checked_limit(limit_mm: float) -> float:
    """Return the value of ``--limit-mm``.

    Raises:
        InputError: it is out of range.
    """
    if not 0.0 < limit_mm < np.inf:
        raise option_error("--limit-mm", limit_mm, "must be above 0 mm and finite")
    return limit_mm


@dataclass(frozen=True)
class ResultOptions:
    """Options of every calibration.

    Attributes:
        output: calibration file, written if it is accepted; None: not written.
        report: HTML report; None: beside `output`, if that is given.
        limit_mm: largest accepted error; None: the default of the calibration.
    """

    output: Path | None = None
    report: Path | None = None
    limit_mm: float | None = None

    def write_report(self, page: Callable[[], str], console: Console) -> None:
        """Write the report, if any, and print its name."""
        if self.report is not None:
            write_atomic(self.report, page())
            console.say(f"report: {self.report}")

    def checked(
        self,
        inputs: Sequence[Path | None],
        marks: Mapping[str, Sequence[bytes]] | None = None,
        format: str = ".toml",
    ) -> Self:
        """Return the options with the name of the report.

        Call this before the calibration, which takes long: it checks that the files can be written.

        Args:
            inputs: files that the command reads.
            marks: option -> texts. An existing file is overwritten only if it has one of them at its start.
            format: suffix of the output; a name without any is allowed.

        Raises:
            InputError: an output file is one of `inputs`, not a regular file, named like an image, not an earlier
                result, or named twice; or its folder is not writable.
        """
        output, report = self.output, self.report
        for option, path in ((OUTPUT, output), (REPORT, report)):
            if path is not None:
                _require_name(option, path)
        if report is None and output is not None:
            report = output.with_suffix(".html")
        outputs = [(o, path) for o, path in ((OUTPUT, output), (REPORT, report)) if path is not None]
        for option, path in outputs:
            keep_apart(path, *inputs, kind=None)
            if any(path.resolve() == read.resolve() for read in inputs if read is not None):  # not there yet
                raise _file_error(option, path, "is also the name of an input; give another file")
            if path.exists() and not path.is_file():
                raise _file_error(option, path, "is not a regular file; give the name of a file")
            if path.suffix.lower() in IMAGE_SUFFIXES:
                raise _file_error(
                    option, path, "has the suffix of an image; use .toml, and .html for the report"
                )
            _require_folder(option, path)
            _require_ours(option, path, (marks or {}).get(option, ()))
        if len({path.resolve() for _, path in outputs}) < len(outputs):
            rule = "is also the name of the report; give -o and --report different names"
            raise _file_error(*outputs[0], rule)
        if report is not None and (fault := page_fault(report)):
            raise _file_error(REPORT, report, fault)
        if output is not None and output.suffix and output.suffix.lower() != format:
            raise _file_error(OUTPUT, output, f"must end in {format}, as it is {format[1:].upper()}")
        return replace(self, report=report)


def _require_name(option: str, path: Path) -> None:
    """Refuse a path that the operating system does not accept as a file name."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return
    except (OSError, ValueError) as error:  # OSError: too long, circular links; ValueError: a zero byte
        why = error.strerror if isinstance(error, OSError) else "it contains a zero byte"
        raise _file_error(option, path, f"cannot be the name of a file: {why}") from error
    if not path.name:
        raise _file_error(option, path, "is not a regular file; give the name of a file")


def _require_folder(option: str, path: Path) -> None:
    """Refuse a path whose folder is not writable and cannot be created."""
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
        raise _file_error(option, path, f"{folder} is not writable; give another file")


def _require_ours(option: str, path: Path, marks: Sequence[bytes]) -> None:
    """Refuse to overwrite a file that this command did not write, such as a cell file given by mistake."""
    if not marks or not path.exists():
        return
    try:
        with open_file(path, "JSON") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise _file_error(option, path, f"cannot be read: {error.strerror}") from error
    if head and not any(mark in head for mark in marks):
        what = {OUTPUT: "calibration", REPORT: "report"}[option]
        raise _file_error(
            option,
            path,
            f"exists and is no {what} that this command wrote, so it is not overwritten; give another file, or remove "
            "it first",
        )
