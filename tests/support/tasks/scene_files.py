"""Scene files."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from arm.io.storage import data_file
from cell.cli.main import main

FOLDER = data_file("scenes/fixtures")


def run(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["a465", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def changed(tmp_path: Path, old: str, new: str, name: str = "capsule") -> Path:
    text = (FOLDER / f"{name}.toml").read_text()
    assert old in text
    path = tmp_path / f"{name}.toml"
    path.write_text(text.replace(old, new, 1))
    return path
