"""Write a folder atomically."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from arm.errors import InputError
from arm.io.storage import unmade, write_atomic
from arm.io.temporary import TemporaryFolder


def write_folder(path: Path, files: Mapping[str, bytes | str]) -> None:
    """Write a new folder: all files into a hidden folder beside it, which is then renamed.

    Args:
        path: of the folder; it may exist if it is empty.
        files: relative name to content.

    Raises:
        InputError: `path` exists and is not an empty folder, or it cannot be written; nothing is left behind.
    """
    try:
        if path.is_symlink() or (path.exists() and (not path.is_dir() or any(path.iterdir()))):
            why = f"{path}: must be a new or an empty folder; existing files are never replaced"
            raise InputError(why, folder=str(path))
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryFolder(path) as temporary:
            for name, content in files.items():
                write_atomic(temporary.path / name, content)
            temporary.become()
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {unmade(path, error)}", folder=str(path)) from error
