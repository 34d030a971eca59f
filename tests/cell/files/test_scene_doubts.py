"""Values of a scene that its rules allow, and that are rather meant otherwise, are told; shipped scenes have none."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cell.files.scene import read_scene_file
from cell.files.scene_doubts import scene_doubts
from tasks.scene_files import FOLDER, changed


@pytest.mark.parametrize("file", sorted(FOLDER.glob("*.toml")), ids=lambda p: p.stem)
def test_no_shipped_scene_is_doubted(file: Path) -> None:
    assert scene_doubts(read_scene_file(file)) == ()


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        (
            "capsule",
            "q_deg = [10, -40, -80, 0, -60, 0]",
            "q_deg = [0.1745, -0.6981, -1.3963, 0, -1.0472, 0]",
            r"queries\[0\] \(over its middle\): q_deg = .* is it in rad\? Then it must be \[9.99",
        ),
        (
            "capsule",
            "from_deg = [-35, -52, -80, 0, -48, 0]",
            "from_deg = [-0.61, -0.9, -1.4, 0, -0.83, 0]",
            r"motions\[0\] \(past the high end\): from_deg = .* is it in rad\?",
        ),
        (
            "capsule",
            "from_deg = [-35, -52, -80, 0, -48, 0]",
            "from_deg = [-14, -50, -84, 0, -46, 0]",
            r"motions\[0\] \(past the high end\): from_deg and to_deg are the same: nothing moves",
        ),
        (
            "capsule",
            "size_mm = [1300, 1500, 40]",
            "size_mm = [1300, 1500, 400]",
            r"bodies\[0\] \(table\): the arm's base is \d+ mm inside it",
        ),
        (
            "held_over_plates",
            "centre_mm = [0, 0, 3]",
            "centre_mm = [420, 50, 80]",
            r"held.centre_mm = \[420, 50, 80\]: is 430 mm from the finger tips: is it in the base frame\?",
        ),
        (
            "held_over_plates",
            "jaw_opening_mm = 40",
            "jaw_opening_mm = 30",
            r"jaw_opening_mm = 30: what is held is 40 mm wide: the fingers are inside it",
        ),
        (
            "held_over_plates",
            "jaw_opening_mm = 40",
            "jaw_opening_mm = 80",
            r"jaw_opening_mm = 80: what is held is 40 mm wide: the fingers do not touch it",
        ),
    ],
)
def test_what_is_rather_meant_otherwise_is_told(
    name: str, old: str, new: str, told: str, tmp_path: Path
) -> None:
    doubts = scene_doubts(read_scene_file(changed(tmp_path, old, new, name)))
    assert len([one for one in doubts if re.match(told, one)]) == 1, doubts
