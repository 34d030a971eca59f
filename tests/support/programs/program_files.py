"""Program files for the cell with a tool that has no jaws (`programs.tool_cells`)."""

from __future__ import annotations

from pathlib import Path

from programs.tool_cells import tool_cell

WIRE = """line_mm = [[0, 0, 0], [0, 0, 200]]
[[bodies]]
name = "bar"
centre_mm = [0, 0, 100]
size_mm = [10, 10, 200]
"""

PROGRAM = """program = "a test"
cell = "cell.toml"
clearance_mm = 6
end_deg = [0, 0, -45, 0, -45, 0]

[work]
origin_mm = [460, 0, 33]
rpy_deg = [0, 0, 180]

[[bodies]]
file = "wire.toml"

[[bodies]]
name = "block"
centre_mm = [100, 0, 10]
size_mm = [20, 20, 20]

[[steps]]
name = "above"
at_mm = [0, 0, 300]
rpy_deg = [0, 0, 0]
free = "rz"
dwell_s = 0.5

[[steps]]
name = "wire"
line_of = "wire.toml"
backwards = true
extend_mm = [60, -30]
axis = "along"
free = "rz"
tilt_deg = 30
touch = [["ring", "bar"]]

[[steps]]
joints_deg = [0, 0, -45, 0, -45, 0]
"""


def program(folder: Path, text: str = PROGRAM) -> Path:
    """Write a program file, its wire file and its cell into a folder; return the program file."""
    cell = tool_cell(folder)
    cell.with_name("wire.toml").write_text(WIRE)
    file = cell.with_name("program.toml")
    file.write_text(text)
    return file
