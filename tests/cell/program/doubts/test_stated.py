"""Values of a program that may be in another unit are told with their key, and nothing of the shipped programs is."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from arm.io.storage import data_file
from cell.program.doubts.stated import stated_doubts
from cell.program.program_file import read_program
from typed.command_line import replace_in

SHIPPED = [
    str(file.relative_to(data_file("scenes")))
    for pattern in ("pallet.toml", "pen/drawing.toml", "polish/pass.toml", "hoop/?.toml", "hoop/realistic/?.toml")
    for file in sorted(data_file("scenes").glob(pattern))
] + ["hoop/seen.toml"]  # fmt: skip


@pytest.mark.parametrize("name", SHIPPED)
def test_nothing_of_the_shipped_programs_is_doubtful(name: str) -> None:
    assert list(stated_doubts(read_program(data_file("scenes") / name))) == []


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("pen/drawing.toml", "width_mm = 210", "width_mm = 21",
         "steps[0].width_mm = 21: drawing.svg states a width of 210 mm, so it is drawn 0.1 times as large"),
        ("pen/drawing.toml", "deviation_mm = 0.5", "deviation_mm = 50",
         "steps[0].deviation_mm = 50: corners of a path that is 195 mm large may be rounded so far"),
        ("pen/drawing.toml", "speed_mm_s = 60", "speed_mm_s = 1200",
         "steps[0].speed_mm_s = 1200: is it in mm/min? Then it must be 20 in mm/s"),
        ("pen/drawing.toml", 'free = "rz"', "ranges = { rz_deg = [-3.14, 3.14] }",
         "steps[0].ranges.rz_deg = [-3.14, 3.14]: is it in rad? Then it must be [-179.9, 179.9] in deg"),
        ("pen/drawing.toml", "rpy_deg = [0, 0, -90]", "rpy_deg = [0, 0, -1.57]",
         "work.rpy_deg = [0, 0, -1.57]: is it in rad? Then it must be [0, 0, -89.95] in deg"),
        ("polish/pass.toml", "pitch_mm = 4", "pitch_mm = 89",
         "steps[0].pitch_mm = 89: is more than meander_mm[1], so there are two lines only"),
        ("polish/pass.toml", "tilt_deg = 25", "tilt_deg = 0.436",
         "steps[0].tilt_deg = 0.436: is it in rad? Then it must be 24.98 in deg"),
        ("hoop/seen.toml", "[37.5, -37.5, 2.5]", "[0.0375, -0.0375, 0.0025]",
         "work.origin_mm = [0.0375, -0.0375, 0.0025]: is it in metres? In mm it must be [37.5, -37.5, 2.5]"),
        ("polish/pass.toml", "centre_mm = [60, 50, -35]", "centre_mm = [0.06, 0.05, -0.035]",
         "bodies[0].centre_mm = [0.06, 0.05, -0.035]: is it in metres? In mm it must be [60, 50, -35]"),
        ("pen/drawing.toml", 'svg = "drawing.svg"\nwidth_mm = 210\nlift_mm = 5\ndeviation_mm = 0.5',
         "points_mm = [[0.01, 0.01, 0.05], [0.1, 0.01, 0.05]]\ndeviation_mm = 0",
         "steps[0].points_mm: the path is 0.09 mm large: are the points in metres?"),
        ("pallet.toml", "approach_mm = 60\nretract_mm = 60", "speed_mm_s = 50",
         'steps[0].speed_mm_s: has no effect without lines: give by = "line", approach_mm or retract_mm'),
    ],
)  # fmt: skip
def test_a_doubtful_value_is_told(tmp_path: Path, name: str, old: str, new: str, told: str) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / name
    replace_in(file, old, new)
    assert list(stated_doubts(read_program(file))) == [f"{file.name}: {told}"]


def test_a_wire_whose_bodies_go_on_where_its_line_ends_is_told(tmp_path: Path) -> None:
    file = Path(shutil.copytree(data_file("scenes"), tmp_path / "scenes")) / "hoop/a.toml"
    replace_in(file.parent / "wires/a.toml", "  [0, 0, 200],", "  [0, 0, 20],")
    told = "a.toml: line_mm: its bodies reach 180 mm beyond its free end, on which the ring is threaded: is the line"
    (found,) = stated_doubts(read_program(file))
    assert found.startswith(told)
