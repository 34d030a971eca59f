"""The project's data files, size-limited reading, atomic writing, canonical JSON and hashes.

Only regular files are read, and each kind of file has a size limit (`MOST_BYTES`), because a pipe, a terminal or
``/dev/zero`` would block the program or fill the memory.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import stat
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO

from arm.errors import FileInputError, InputError
from arm.io.foreign import binary, markup, printed, table, yaml
from arm.io.slips.names import missing
from arm.io.temporary import TemporaryFile, mode_of_new

_SOURCE = Path(__file__).resolve().parents[2]
# The checkout comes first: an editable install also has the wheel's copy, which would hide edits.
DATA_ROOTS = (_SOURCE.parent, _SOURCE / "cell" / "_data")


def data_file(relative: str) -> Path:
    """Return the path of the project's data file `relative`, such as ``urdf/a465/a465.urdf``.

    Raises:
        InputError: no data root has it.
    """
    for root in DATA_ROOTS:
        if (root / relative).exists():
            return root / relative
    why = f"data file {relative!r} is neither in the checkout nor in the installed package; reinstall a465"
    raise InputError(why, file=relative)


MB = 1_000_000
_MOST_NAMES = 5  # of files in a folder, in a message
MOST_BYTES = {
    "TOML": 2 * MB,  # a cell file has 10 kB, a calibration file 100 kB
    "text": 20 * MB,  # CSV, URDF, SRDF, vendored scripts
    "SVG": 20 * MB,
    "JSON": 200 * MB,  # a plan of a whole task has 1 MB
    "pose list": 100 * MB,
    "mesh": 100 * MB,
    "photograph": 200 * MB,
    "background": 20 * MB,  # 300 features have 0.2 MB
    "log": 4000 * MB,  # read line by line; 1 MB a minute of motion
}
"""Largest size of a file of each kind; larger ones are refused before they are read."""


_FORMATS = ("TOML", "JSON", "SVG")  # kinds that a person knows by name
_WIRE_LOG = "wire.jsonl"  # in the folder of a run
LARGEST = 1e100  # largest number in a file

# device and inode of the files that a command will overwrite; None outside of commands
_OVERWRITTEN: ContextVar[set[tuple[int, int]] | None] = ContextVar("overwritten", default=None)
# files that were read since the beginning of `files_read`; None outside of it
_READ: ContextVar[dict[Path, None] | None] = ContextVar("read", default=None)
# contents of files, by absolute path, that are read instead of those on disk
_INSTEAD: ContextVar[Mapping[str, bytes]] = ContextVar("instead", default=MappingProxyType({}))


def open_file(path: Path, kind: str) -> BinaryIO:
    """Open a regular file of at most `MOST_BYTES` of its kind for reading.

    Raises:
        FileInputError: the file is missing, not readable, not a regular file, or too large.
    """
    if (instead := _INSTEAD.get()) and (other := instead.get(os.path.abspath(path))) is not None:
        return io.BytesIO(other)
    try:
        # without O_NONBLOCK, opening a pipe waits for a writer
        handle = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        help = missing(path) if isinstance(error, FileNotFoundError) else ""
        raise FileInputError(path, "", None, f"cannot be read: {error.strerror}", help) from error
    except ValueError as error:  # a zero byte or half a surrogate in the name
        raise FileInputError(Path(ascii(str(path))), "", None, f"is not a file name: {error}") from error
    try:
        found = os.fstat(handle)
        if stat.S_ISDIR(found.st_mode):
            raise FileInputError(path, "", None, "is a folder, must be a file", _inside(path))
        if not stat.S_ISREG(found.st_mode):
            help = (
                "is it the controller's port, in the place of a file?"
                if os.isatty(handle)
                else "copy it to a file"
            )
            raise FileInputError(
                path, "", None, f"is {_what(found.st_mode)}; only regular files are read", help
            )
        if found.st_size > MOST_BYTES[kind]:
            raise _too_large(path, kind, os.pread(handle, 512, 0))
        if (found.st_dev, found.st_ino) in (_OVERWRITTEN.get() or ()):
            raise read_by_the_command(path)
        if (read := _READ.get()) is not None:
            read[path] = None
        return os.fdopen(handle, "rb")
    except BaseException:
        os.close(handle)
        raise


def _inside(folder: Path) -> str:
    """What of the project's files a folder holds, for a message."""
    names = sorted(one.name for one in folder.iterdir() if one.suffix in (".toml", ".json", ".jsonl"))
    if _WIRE_LOG in names:
        return f"it is of a run: its log is {folder / _WIRE_LOG}"
    return (
        f"it holds {', '.join(names[:_MOST_NAMES])}{', ...' if len(names) > _MOST_NAMES else ''}"
        if names
        else ""
    )


_TEXTS = ("TOML", "JSON", "CSV")  # kinds of files that no image or archive is


def read_bytes(path: Path, kind: str) -> bytes:
    """Return the content of a regular file of at most `MOST_BYTES` of its kind.

    Raises:
        FileInputError: the file is missing, not readable, not a regular file, or too large.
    """
    with open_file(path, kind) as stream:
        try:
            data = stream.read(MOST_BYTES[kind] + 1)  # files in /proc report a size of 0
        except OSError as error:
            raise FileInputError(path, "", None, f"cannot be read: {error.strerror}") from error
    if len(data) > MOST_BYTES[kind]:
        raise _too_large(path, kind, data)
    return data


def _too_large(path: Path, kind: str, begin: bytes) -> FileInputError:
    if kind in _TEXTS and (foreign := binary(begin)):
        return FileInputError(path, "", None, f"{foreign}; {_belongs(kind)}")
    rule = f"has more than {MOST_BYTES[kind] // MB} MB, which is the limit for a {kind} file"
    return FileInputError(path, "", None, rule)


def _what(mode: int) -> str:
    kinds = {
        stat.S_IFIFO: "a named pipe",
        stat.S_IFCHR: "a character device",
        stat.S_IFBLK: "a block device",
        stat.S_IFSOCK: "a socket",
    }
    return kinds.get(stat.S_IFMT(mode), "not a regular file")


def _belongs(kind: str) -> str:
    return f"a {kind if kind in _FORMATS else 'text'} file belongs here"


def read_text(path: Path, kind: str = "text") -> str:
    r"""Return the text of a UTF-8 file with ``\n`` as line ends, without a byte order mark.

    Raises:
        FileInputError: the file is missing, not readable, not a regular file, too large, or not text.
    """
    try:
        text = (data := read_bytes(path, kind)).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        foreign = binary(data)
        rule = (
            foreign
            if "text" in foreign
            else f"{foreign}; {_belongs(kind)}"
            if foreign
            else f"is not UTF-8 text: byte {error.start} cannot be read"
        )
        raise FileInputError(path, "", None, rule) from error
    if "\0" in text[:1000] and (foreign := binary(data)):  # some are UTF-8 by chance
        raise FileInputError(path, "", None, f"{foreign}; {_belongs(kind)}")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def begins_as_object(path: Path) -> bool:
    """Whether a file begins as a JSON object does; False for a file that cannot be read. Reads 100 bytes."""
    with suppress(FileInputError, OSError), open_file(path, "log") as stream:
        return stream.read(100).lstrip().startswith(b"{")
    return False


def read_json(path: Path) -> Any:
    """Return the value in a JSON file.

    Raises:
        FileInputError: the file cannot be read, or is not JSON.
    """
    try:
        return json.loads(read_text(path, "JSON"), object_pairs_hook=partial(_once, path))
    except json.JSONDecodeError as error:
        if foreign := markup(error.doc) or printed(error.doc) or table(error.doc) or yaml(error.doc):
            raise FileInputError(path, "", None, f"{foreign}, and a JSON file belongs here") from error
        if not error.doc.strip():
            raise FileInputError(path, "", None, "is empty, and a JSON file belongs here") from error
        last, rest = error.doc[: error.pos].rstrip()[-1:], error.doc[error.pos :].lstrip()
        if rest[:1] == ",":  # Python 3.13 points at a comma too many, older versions at what follows it
            last, rest = ",", rest[1:].lstrip()
        help = "a comma stands before a bracket that ends" if last == "," and rest[:1] in ("]", "}") else ""
        if error.msg == "Extra data":
            help = (
                "a second document follows the first; one document belongs here: was the file appended to? Several, "
                "if they are allowed, stand in a list, [..., ...]"
            )
        if error.msg.startswith("Expecting property name") and rest[:1] == "'":
            help = "text stands in double quotation marks: is it printed by Python? json.dump writes JSON"
        if rest.startswith(("//", "/*", "#")):
            help = "JSON has no comments"
        if error.pos and (not rest or error.msg.startswith("Unterminated string")):
            help = "the file ends too early: was it written to its end?"
        raise FileInputError(path, "", None, f"is not JSON: {error}", help) from error
    except ValueError as error:
        most = sys.get_int_max_str_digits()
        raise FileInputError(path, "", None, f"has a number of more than {most} digits") from error
    except RecursionError as error:
        raise FileInputError(path, "", None, "is nested too deeply") from error


def _once(path: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object, each key of which must be there once: of two values nobody knows which one is meant."""
    read = dict(pairs)
    if len(read) < len(pairs):
        twice = next(key for key, count in Counter(key for key, _ in pairs).items() if count > 1)
        raise FileInputError(path, twice, None, "is there twice in one object; remove one of both")
    return read


def require_finite(path: Path, value: Any) -> None:
    """Require that a file's numbers are finite and can be squared, and that its integers have at most 64 bits.

    Raises:
        FileInputError: a number breaks the rule; the message names its key.
    """
    for key, leaf in leaves(value):
        require_64_bits(path, key, leaf)
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise FileInputError(path, key, leaf, "must be a finite number")
        if isinstance(leaf, float) and abs(leaf) > LARGEST:
            raise FileInputError(path, key, leaf, f"must be a number from {-LARGEST:g} to {LARGEST:g}")


def require_64_bits(path: Path, key: str, value: Any) -> None:
    """Require that a value is not an integer of more than 64 bits, which `json` and `tomllib` accept.

    Raises:
        FileInputError: it is such an integer.
    """
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise FileInputError(path, key, value, "must be a whole number of at most 64 bits")


def leaves(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the leaves of nested tables and lists with their keys, in the file's order."""
    left = [("", value)]
    while left:
        key, now = left.pop()
        if isinstance(now, dict):
            left += [(f"{key}.{name}" if key else name, inner) for name, inner in reversed(now.items())]
        elif isinstance(now, list):
            left += [(f"{key}[{i}]", now[i]) for i in reversed(range(len(now)))]
        else:
            yield key, now


def read_by_the_command(path: Path) -> InputError:
    """Return the error of an output that is also an input."""
    why = f"{path}: is read by this command, so it is not overwritten; give another file"
    return InputError(why, file=str(path))


@contextmanager
def files_read() -> Iterator[dict[Path, None]]:
    """Collect the files that are read inside the block, in their order, as they are named there."""
    read: dict[Path, None] = {}
    before = _READ.set(read)
    try:
        yield read
    finally:
        _READ.reset(before)


@contextmanager
def read_instead(contents: Mapping[Path, bytes]) -> Iterator[None]:
    """Read files inside the block as if they had these contents."""
    before = _INSTEAD.set({os.path.abspath(path): content for path, content in contents.items()})
    try:
        yield
    finally:
        _INSTEAD.reset(before)


@contextmanager
def one_command() -> Iterator[None]:
    """Forget at the end what `keep_unread` was told."""
    before = _OVERWRITTEN.set(set())
    try:
        yield
    finally:
        _OVERWRITTEN.reset(before)


def keep_unread(*outputs: Path | None) -> None:
    """Refuse to read files that this command will overwrite, from here on; for files that its input names.

    Within `one_command`; without effect elsewhere.
    """
    overwritten = _OVERWRITTEN.get()
    for output in outputs:
        if overwritten is not None and output is not None and output.exists():
            found = output.stat()
            overwritten.add((found.st_dev, found.st_ino))


def write_atomic(path: Path, data: bytes | str | Iterable[str], tidy: bool = True) -> None:
    """Write a file whole or not at all (a temporary file in the same folder, synced, then renamed).

    If `path` is a link, the file it refers to is written. An existing file keeps its mode.

    Args:
        path: of the file.
        data: its content, or the parts of it, which need not be in memory together.
        tidy: first remove what killed programs left in the folder, which is listed for that.

    Raises:
        InputError: the folder is missing, read-only or full; an existing file is then unchanged.
    """
    parts = [data] if isinstance(data, bytes) else (text.encode() for text in _texts(data))
    path = path.resolve() if path.is_symlink() else path
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is not a regular file, so it is not replaced", file=str(path))
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(path, tidy) as temporary:
            temporary.write(parts)
            temporary.become(stat.S_IMODE(path.stat().st_mode) if path.exists() else mode_of_new())
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {unmade(path, error)}", file=str(path)) from error


def unmade(path: Path, error: OSError) -> str:
    """Say why a file or folder cannot be made: the system's words, or which file stands where a folder has to be."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        above = next((one for one in path.parents if one.exists()), path)
        if not above.is_dir():
            return f"{above} is a file, not a folder"
    return str(error.strerror)


def _texts(data: str | Iterable[str]) -> Iterable[str]:
    return [data] if isinstance(data, str) else data


def canonical_json(value: Any) -> str:
    """Return the unique text of a value, for hashes: sorted keys, no spaces, shortest exact floats, no NaN."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def sha256(value: bytes | str | dict[str, Any] | list[Any]) -> str:
    """Return the hex SHA-256 of bytes, of text in UTF-8, or of a value's canonical JSON."""
    if isinstance(value, dict | list):
        value = canonical_json(value)
    return hashlib.sha256(value.encode() if isinstance(value, str) else value).hexdigest()
