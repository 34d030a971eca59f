"""World files: where boards stand."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.files.world import board_placement, read_world
from typed.command_line import replace_in


def test_the_shipped_world_stands_where_the_page_of_sources_says() -> None:
    world = read_world(data_file("scenes/task2.world.toml"), 0.036)
    origins = [b.T_base_board[:3, 3] for b in world.boards]
    assert origins[0] == pytest.approx([0.5557, 0.1714, 0.0485], abs=5e-5)
    assert origins[1] == pytest.approx([0.5300, -0.2169, 0.0667], abs=5e-5)
    assert [np.degrees(np.arccos(b.T_base_board[2, 2])) for b in world.boards] == pytest.approx([7, 15])


def test_placement_puts_the_plates_centre_and_leans_where_it_is_told() -> None:
    rng = np.random.default_rng(4)
    for _ in range(50):
        centre, azimuth = rng.uniform(-1, 1, 3), rng.uniform(-np.pi, np.pi)
        T = board_placement(centre, rng.uniform(-np.pi, np.pi), 0.2, azimuth)
        assert T @ np.array([0.09, 0.07, 0, 1]) == pytest.approx([*centre, 1], abs=1e-12)
        assert np.arctan2(T[1, 2], T[0, 2]) == pytest.approx(azimuth, abs=1e-9)
        assert T[2, 2] == pytest.approx(np.cos(0.2))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("cubes = [1, 2, 3, 4]", "cubes = [0, 1]", r"boards\[0\].cubes"),
        ("tilt_deg = 7", "tilt_deg = -7", r"boards\[0\].tilt_deg = -7"),
        (
            "[460, 110, 40]",
            "[0.46, 0.11, 0.04]",
            r"boards\[0\].centre_mm = \[0.46, .*arm's axis.*in metres\?",
        ),
        (
            "plate_03-04.csv",
            "plate_01-02.csv",
            r"boards\[1\].file = .*: has the marker 1 of a board before it",
        ),
        ("noise_grey = 2.0", 'noise_grey = "low"', "noise_grey = 'low'"),
        (
            "noise_grey = 2.0",
            "tool.ring_mm = [70, 60, 7]",
            r"tool.ring_mm = \[70, 60, 7\]: must be inner diameter, outer",
        ),
        (
            "boards/positions_plate_01-02.csv",
            "hoop/boards/puzzle_01-02.toml",
            r"boards\[0\].cubes.*without holes",
        ),
    ],
)
def test_mistakes_in_a_world_are_told(scenes: Path, old: str, new: str, message: str) -> None:
    replace_in(scenes / "task2.world.toml", old, new)
    with pytest.raises(InputError, match=message):
        read_world(scenes / "task2.world.toml", 0.036)


def test_a_board_may_slide_after_a_grasp(tmp_path: Path) -> None:
    shutil.copytree(data_file("scenes"), tmp_path / "scenes")
    file = tmp_path / "scenes/task2.world.toml"
    replace_in(
        file, "tilt_deg = 15", "tilt_deg = 15\nshifts_mm = [3, -2]\nshifts_deg = 1.5\nshifts_after = 4"
    )
    still, slides = read_world(file, 0.036).boards
    assert (still.shift, still.shifts_after) == (None, 1)
    assert slides.shift == pytest.approx((0.003, -0.002, np.radians(1.5)))
    assert slides.shifts_after == 4
