"""Writes study files beside a copy of the shipped scenes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from arm.io.toml_writer import toml_lines

X = {"key": "boards[1].centre_mm[0]", "name": "x", "from": 420.0, "to": 500.0}
YAW = {"key": "boards[1].yaw_deg", "name": "yaw", "from": 60.0, "to": 120.0}


def write_study(scenes: Path, vary: Sequence[dict[str, Any]] = (X, YAW), **keys: Any) -> Path:
    """Return a study file of Task 2; `keys` are of its first table, besides `task`."""
    file = scenes / "study.toml"
    lines = toml_lines({"task": "task2.toml", **keys})
    for one in vary:
        lines += ["[[vary]]", *toml_lines(one)]
    file.write_text("\n".join(lines) + "\n")
    return file
