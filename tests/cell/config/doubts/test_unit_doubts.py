"""Values of a user's own unit that may be in another unit, order or sign."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.controller.unit import UNITS, load_unit
from arm.io.storage import data_file
from cell.config.cell_file import read_cell
from cell.config.doubts.cell_doubts import cell_doubts
from cell.config.doubts.unit_doubts import unit_doubts
from typed.command_line import replace_in


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    file = tmp_path / "mine.toml"
    file.write_text(data_file("urdf/a465/crs93.toml").read_text().replace('"crs93"', '"mine"'))
    return file


@pytest.mark.parametrize("name", UNITS)
def test_a_shipped_unit_and_a_copy_of_it_raise_no_doubt(name: str, tmp_path: Path) -> None:
    file = tmp_path / "copy.toml"
    file.write_text(data_file(f"urdf/a465/{name}.toml").read_text().replace(f'"{name}"', '"mine"'))
    assert unit_doubts(load_unit(name)) == unit_doubts(load_unit(file)) == ()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "speed = [7680, 2048, 5120, 7680, 7680, 19200]",
            "speed = [30, 8, 20, 30, 30, 75]",
            "registers.speed = [30, 8, 20, 30, 30, 75]: is 0.0039 times that of a shipped unit; is it in",
        ),
        (
            "soft_home_deg = [0.0, 0.0, -45.0,",
            "soft_home_deg = [0.0, 0.0, 45.0,",
            "homing.soft_home_deg = [0, 0, 45, 0, -45, 0]: differs by signs alone: crs93 has 0, 0, -45, 0, -45, 0",
        ),
        (
            "[51, 10, 20, 38, 128, 768]",
            "[10, 51, 20, 38, 128, 768]",
            "registers.acceleration = [10, 51, 20, 38, 128, 768]: has the numbers of crs93 in another order: crs93 has",
        ),
        (
            "open_adc = 840",
            "open_adc = 84",
            "gripper.open_adc = 84: is 0.084 times that of a shipped unit; is it in another",
        ),
        ("p = [10, 12, 70, 35, 45, 100]", "p = [12, 14, 60, 35, 45, 90]", ""),
        ("counts_at_zero = [-181650,", "counts_at_zero = [-181000,", ""),
        ('model = "CRS A465"', 'model = "CRS A255"', ""),
    ],
)
def test_a_value_that_may_be_meant_otherwise_is_told(old: str, new: str, told: str, mine: Path) -> None:
    replace_in(mine, old, new)
    found = unit_doubts(load_unit(mine))
    assert len(found) == bool(told)
    assert told in "".join(found)


def test_a_cell_tells_the_doubts_about_its_unit(scenes: Path, mine: Path) -> None:
    cell = scenes / "cell.toml"
    mine.rename(scenes / "mine.toml")
    replace_in(cell, 'unit = "crs93"', 'unit = "mine.toml"')
    assert cell_doubts(read_cell(cell)) == ()
    replace_in(scenes / "mine.toml", "open_adc = 840", "open_adc = 90")
    (told,) = cell_doubts(read_cell(cell))
    assert "unit mine: gripper.open_adc = 90" in told
