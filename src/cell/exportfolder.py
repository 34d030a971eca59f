"""A folder that is written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from arm.errors import InputError
from arm.files import write_atomic


def write_folder(path: Path, files: Mapping[str, bytes | str]) -> None:
    """Write a new folder: all files into a hidden one beside it, which then gets its name.

    Args:
        path: of the folder; it may exist if it is empty.
        files: content by relative name.

    Raises:
        InputError: there is something at `path`, or it cannot be written; nothing of it is then there.
    """
    try:
        if path.is_symlink() or (path.exists() and (not path.is_dir() or any(path.iterdir()))):
            raise InputError(
                f"{path}: must be a new or an empty folder; what is there is not mixed with an export, nor replaced",
                folder=str(path),
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}", folder=str(path)) from error
    try:
        for name, content in files.items():
            write_atomic(temporary / name, content)
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o777 & ~umask)
        temporary.rename(path)  # an empty folder is replaced, one that was filled meanwhile is not
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}", folder=str(path)) from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
