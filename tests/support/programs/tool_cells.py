"""A cell whose tool has no jaws: the shipped cell with a ring of boxes on a handle at the flange."""

from __future__ import annotations

import re
from pathlib import Path

from tasks.small import small_scenes

TOOL = """origin_mm = [-135, 0, 13]
rpy_deg = [180, 0, 180]

[[bodies]]
name = "handle"
centre_mm = [-60, 0, 13]
size_mm = [90, 15, 6.6]

[[bodies]]
name = "ring"
shape = "cylinder"
centre_mm = [-135, 0, 13]
radius_mm = 34.8
length_mm = 6.6
"""


def tool_cell(folder: Path) -> Path:
    """Write the scenes into a folder, the cell with the tool; return the cell file."""
    small_scenes(folder)
    cell = folder / "scenes/cell.toml"
    text = re.sub(
        r"\[tool\].*?(?=\[cube\])", '[tool]\nbodies = "tool.toml"\n\n', cell.read_text(), flags=re.S
    )
    cell.write_text(text)
    cell.with_name("tool.toml").write_text(TOOL)
    return cell
