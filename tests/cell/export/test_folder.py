"""Folders that are written whole or not at all."""

from __future__ import annotations

import stat
from pathlib import Path

import pytest

import cell.export.folder
from arm.errors import InputError
from cell.export.folder import write_folder


def test_a_folder_is_there_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    write_folder(folder, {"a": "1", "b/c": b"2"})  # an empty one may be there
    assert (folder / "b/c").read_bytes() == b"2"
    assert stat.S_IMODE(folder.stat().st_mode) & 0o700 == 0o700
    assert stat.S_IMODE(folder.stat().st_mode) == stat.S_IMODE((folder / "b").stat().st_mode)
    for taken in (folder, folder / "a"):
        with pytest.raises(InputError, match="must be a new or an empty folder"):
            write_folder(taken, {"a": "3"})
    assert (folder / "a").read_text() == "1"
    with pytest.raises(InputError, match="cannot be written"):
        write_folder(folder / "a" / "deeper", {"a": "3"})

    def full(path: Path, data: bytes | str) -> None:
        if path.name == "second":
            raise InputError("no space")
        path.write_text("half")

    monkeypatch.setattr(cell.export.folder, "write_atomic", full)
    with pytest.raises(InputError, match="no space"):
        write_folder(tmp_path / "new", {"first": "1", "second": "2"})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"]
