"""Data files: where the project's own are found, and how files are written so that none is ever half there."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import os
import stat
import sys
import tempfile
from pathlib import Path
from typing import Any

from arm.errors import FileInputError, InputError

_SOURCE = Path(__file__).resolve().parents[1]
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


def read_text(path: Path) -> str:
    """The text of a file in UTF-8.

    Raises:
        FileInputError: it is not there, not readable, or not text.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FileInputError(
            path, "", None, f"is not UTF-8 text: byte {error.start} cannot be read"
        ) from error
    except OSError as error:
        raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except ValueError as error:  # a zero byte or half a surrogate in the name
        raise FileInputError(Path(ascii(str(path))), "", None, f"is no file name: {error}") from error


def read_json(path: Path) -> Any:
    """The value in a JSON file.

    Raises:
        FileInputError: it cannot be read, or is no JSON.
    """
    try:
        return json.loads(read_text(path))
    except json.JSONDecodeError as error:
        raise FileInputError(path, "", None, f"is not JSON: {error}") from error
    except ValueError as error:
        most = sys.get_int_max_str_digits()
        raise FileInputError(path, "", None, f"holds a number of more than {most} digits") from error
    except RecursionError as error:
        raise FileInputError(path, "", None, "is nested too deeply") from error


def require_finite(path: Path, value: Any) -> None:
    """See that a file's value holds no NaN and no infinity, which Python reads and JSON does not know.

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
    temporary: str | None = None
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no ordinary file, so it is not replaced", file=str(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.chmod(temporary, _mode_of(path))
        os.replace(temporary, path)
        temporary = None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}", file=str(path)) from error
    finally:
        if temporary is not None:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)


def _mode_of(path: Path) -> int:
    """That of the file, or of a new one."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    umask = os.umask(0)
    os.umask(umask)
    return 0o666 & ~umask


def canonical_json(value: Any) -> str:
    """One text for one value: keys sorted, no spaces, shortest exact floats, no NaN. The base of all hashes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def sha256(value: bytes | str | dict[str, Any] | list[Any]) -> str:
    """Hex SHA-256 of bytes, of text in UTF-8, or of a value's canonical JSON."""
    if isinstance(value, dict | list):
        value = canonical_json(value)
    return hashlib.sha256(value.encode() if isinstance(value, str) else value).hexdigest()
