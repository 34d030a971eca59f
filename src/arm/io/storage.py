"""Files: where the project's own are found, what may be read, and how files are written so that none is half there.

Only regular files are read, and each kind of file has a size limit: a pipe, a terminal or ``/dev/zero`` would block the
program or fill the memory. The limits stand here, in `MOST_BYTES`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import stat
import sys
from pathlib import Path
from typing import Any, BinaryIO

from arm.errors import FileInputError, InputError
from arm.io.temporary import TemporaryFile, mode_of_new

_SOURCE = Path(__file__).resolve().parents[2]
# The checkout comes first: the wheel's copy also exists in an editable install and would hide edits.
DATA_ROOTS = (_SOURCE.parent, _SOURCE / "cell" / "_data")


def data_file(relative: str) -> Path:
    """The project's own file `relative`, such as ``urdf/a465/a465.urdf``.

    Raises:
        InputError: no data root holds it.
    """
    for root in DATA_ROOTS:
        if (root / relative).exists():
            return root / relative
    raise InputError(
        f"data file {relative!r} is neither in the checkout nor in the installed package; reinstall a465",
        file=relative,
    )


MB = 1_000_000
MOST_BYTES = {
    "TOML": 2 * MB,  # a cell file has 10 kB, a calibration 100 kB
    "text": 20 * MB,  # CSV, URDF, SRDF, vendored scripts
    "JSON": 200 * MB,  # a plan of a whole task has 1 MB
    "pose list": 100 * MB,
    "mesh": 100 * MB,
    "photograph": 200 * MB,
    "log": 4000 * MB,  # read line by line; 1 MB a minute of motion
}
"""What a file of each kind may have at most; a larger one is refused before it is read."""


LARGEST = 1e100  # of a number in a file


def open_file(path: Path, kind: str) -> BinaryIO:
    """A regular file of at most `MOST_BYTES` of its kind, open for reading.

    Raises:
        FileInputError: it is not there, not readable, no regular file, or too large.
    """
    try:
        # without O_NONBLOCK, opening a pipe waits until somebody writes to it
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except ValueError as error:  # a zero byte or half a surrogate in the name
        raise FileInputError(Path(ascii(str(path))), "", None, f"is no file name: {error}") from error
    try:
        found = os.fstat(handle)
        if stat.S_ISDIR(found.st_mode):
            raise FileInputError(path, "", None, "cannot be read: Is a directory")
        if not stat.S_ISREG(found.st_mode):
            raise FileInputError(
                path, "", None, f"is {_what(found.st_mode)}; only regular files are read", "copy it to a file"
            )
        if found.st_size > MOST_BYTES[kind]:
            raise _too_large(path, kind)
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def read_bytes(path: Path, kind: str) -> bytes:
    """The content of a regular file of at most `MOST_BYTES` of its kind.

    Raises:
        FileInputError: it is not there, not readable, no regular file, or too large.
    """
    with open_file(path, kind) as stream:
        try:
            data = stream.read(MOST_BYTES[kind] + 1)  # files of /proc say that they are empty
        except OSError as error:
            raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error
    if len(data) > MOST_BYTES[kind]:
        raise _too_large(path, kind)
    return data


def _too_large(path: Path, kind: str) -> FileInputError:
    return FileInputError(
        path, "", None, f"has more than {MOST_BYTES[kind] // MB} MB, which is the limit for a {kind} file"
    )


def _what(mode: int) -> str:
    kinds = {
        stat.S_IFIFO: "a named pipe",
        stat.S_IFCHR: "a character device",
        stat.S_IFBLK: "a block device",
        stat.S_IFSOCK: "a socket",
    }
    return kinds.get(stat.S_IFMT(mode), "no regular file")


def read_text(path: Path, kind: str = "text") -> str:
    """The text of a file in UTF-8; its line ends are those of Python.

    Raises:
        FileInputError: it is not there, not readable, no regular file, too large, or not text.
    """
    try:
        text = read_bytes(path, kind).decode()
    except UnicodeDecodeError as error:
        raise FileInputError(
            path, "", None, f"is not UTF-8 text: byte {error.start} cannot be read"
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_json(path: Path) -> Any:
    """The value in a JSON file.

    Raises:
        FileInputError: it cannot be read, or is no JSON.
    """
    try:
        return json.loads(read_text(path, "JSON"))
    except json.JSONDecodeError as error:
        raise FileInputError(path, "", None, f"is not JSON: {error}") from error
    except ValueError as error:
        most = sys.get_int_max_str_digits()
        raise FileInputError(path, "", None, f"holds a number of more than {most} digits") from error
    except RecursionError as error:
        raise FileInputError(path, "", None, "is nested too deeply") from error


def require_finite(path: Path, value: Any) -> None:
    """See that a file's numbers are finite and can be squared, and its integers of at most 64 bits.

    Raises:
        FileInputError: with the key.
    """
    left = [("", value)]
    while left:
        key, now = left.pop()
        if isinstance(now, dict):
            left += [(f"{key}.{name}" if key else name, inner) for name, inner in now.items()]
        elif isinstance(now, list):
            left += [(f"{key}[{i}]", inner) for i, inner in enumerate(now)]
        elif isinstance(now, float) and not math.isfinite(now):
            raise FileInputError(path, key, now, "must be a finite number")
        elif isinstance(now, float) and abs(now) > LARGEST:
            raise FileInputError(path, key, now, f"must be a number from {-LARGEST:g} to {LARGEST:g}")
        elif isinstance(now, int) and not -(2**63) <= now < 2**63:
            raise FileInputError(path, key, now, "must be a whole number of 64 bits")


def keep_apart(output: Path | None, *inputs: Path | None) -> None:
    """Refuse to write over what is read.

    Raises:
        InputError: `output` is one of `inputs`, by whatever name.
    """
    if output is None or not output.exists():
        return
    for path in inputs:
        if path is not None and path.exists() and output.samefile(path):
            raise InputError(
                f"{output}: is read by this command, so it is not written over; give another file",
                file=str(output),
            )


def write_atomic(path: Path, data: bytes | str) -> None:
    """Write a file whole or not at all (a temporary file in the same folder, synced, then renamed).

    Of a link, the file that it leads to is written; an older file's mode stays.

    Raises:
        InputError: the folder is missing, read-only or full; an older file at `path` is then untouched.
    """
    content = data.encode() if isinstance(data, str) else data
    path = path.resolve() if path.is_symlink() else path
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no ordinary file, so it is not replaced", file=str(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(path) as temporary:
            temporary.write(content)
            temporary.become(_mode_of(path))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}", file=str(path)) from error


def _mode_of(path: Path) -> int:
    """That of the file, or of a new one."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    return mode_of_new()


def canonical_json(value: Any) -> str:
    """One text for one value: keys sorted, no spaces, shortest exact floats, no NaN. The base of all hashes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def sha256(value: bytes | str | dict[str, Any] | list[Any]) -> str:
    """Hex SHA-256 of bytes, of text in UTF-8, or of a value's canonical JSON."""
    if isinstance(value, dict | list):
        value = canonical_json(value)
    return hashlib.sha256(value.encode() if isinstance(value, str) else value).hexdigest()
