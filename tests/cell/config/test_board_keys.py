"""Keys of the cell file about looking at boards: what they do, and mistakes in them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.io.storage import canonical_json
from cell.config.board_keys import DICTIONARIES
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.files.observation import observation_to_json, read_observation
from cell.files.task import read_task
from cell.task.look import look_and_save
from pictures.boards import lab_camera, photograph, random_pose, twist_between
from typed.command_line import replace_in
from vision.boards.checks import BoardLimits
from vision.camera.model import Image


def test_tilts_and_limits_reach_the_cell_and_no_plan_rests_on_them(scenes: Path) -> None:
    file = scenes / "cell.toml"
    shipped = read_cell(file)
    assert np.degrees(shipped.tilts) == pytest.approx([0, 7, 15])
    assert shipped.board_limits == BoardLimits()
    replace_in(file, "tilts_deg = [0, 7, 15]", "tilts_deg = [12.5, 3]")
    replace_in(file, "# least_certain_deg = 1.0", "least_certain_deg = 0.2")
    replace_in(file, "# least_certain_mm = 0.6", "least_certain_mm = 0.3")
    replace_in(file, "# least_certain_height_mm = 2.0", "least_certain_height_mm = 1.0")
    assert {b.tolerance for b in shipped.boards} == {1e-4}
    replace_in(file, "made_within_mm = 0.1", "made_within_mm = 0.25")
    cell = read_cell(file)
    assert {b.tolerance for b in cell.boards} == {2.5e-4}
    assert np.degrees(cell.tilts) == pytest.approx([3, 12.5])
    limits = cell.board_limits
    assert (limits.sideways_m, limits.height_m) == pytest.approx((0.3e-3, 1e-3))
    assert np.degrees(limits.turn_rad) == pytest.approx(0.2)
    assert cell.digest == shipped.digest
    replace_in(file, "tilts_deg = [12.5, 3]", "")
    assert read_cell(file).tilts == ()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0, 7, 15] ", "[0, 7, 90] ", r"tilts_deg = \[0, 7, 90\]: must be a list of angles"),
        ("[0, 7, 15] ", "[0, 0.122, 0.262] ", r"tilts_deg = .*that differ by 0.5 deg or more"),
        ("[0, 7, 15] ", "[7, 7] ", "must be a list of angles from 0 to 45 deg"),
        ("[0, 7, 15] ", "7 ", "tilts_deg = 7: must be a list"),
        ("[0, 7, 15] ", '["7"] ', "must be a list"),
        (
            "# least_certain_deg = 1.0",
            "least_certain_deg = 0",
            "least_certain_deg = 0: must be a number in deg",
        ),
        ("# least_certain_deg = 1.0", "least_certain_degs = 1", "least_certain_deg"),
        (
            "made_within_mm = 0.1",
            "made_within_mm = -0.1",
            r"made_within_mm = -0.1: must be a number in mm",
        ),
        (
            "made_within_mm = 0.1",
            'made_within_mm = "good"',
            "made_within_mm = 'good': must be a number in mm",
        ),
    ],
)
def test_mistakes_are_told(scenes: Path, old: str, new: str, words: str) -> None:
    replace_in(scenes / "cell.toml", old, new)
    with pytest.raises(InputError, match=words):
        read_cell(scenes / "cell.toml")


@pytest.mark.parametrize(
    ("size", "pocket", "words"),
    [
        (
            30,
            "",
            r"cube.size_mm = 30: must fit the pocket, but would lie loose on its floor: pockets are 44 mm",
        ),
        (
            45,
            "",
            r"cube.size_mm = 45: must fit the pocket, but is wider than its mouth: .* 39 mm at the floor",
        ),
        (42, "", r"must sit between 7 and 9 mm deep in the pocket, but would sit 4.0 mm deep"),
        (30, "[34, 29]", ""),
        (40, "[34, 29]", "is wider than its mouth: pockets are 34 mm wide at the mouth and 29 mm"),
        (40, "[44, 44]", r"boards.pocket_mm = \[44, 44\]: must be the widths of mouth and floor"),
        (40, "[44]", r"boards.pocket_mm = \[44\]"),
        (40.4, "", ""),
    ],
)
def test_a_cube_must_fit_its_pocket(scenes: Path, size: float, pocket: str, words: str) -> None:
    file = scenes / "cell.toml"
    replace_in(file, "[cube]\nsize_mm = 40", f"[cube]\nsize_mm = {size}")
    if pocket:
        replace_in(file, "pocket_mm = [44, 39]", f"pocket_mm = {pocket}")
    if words:
        with pytest.raises(InputError, match=words):
            read_cell(file)
    else:
        mouth, floor = (34e-3, 29e-3) if pocket else (44e-3, 39e-3)
        assert read_cell(file).boards[0].pocket == pytest.approx((mouth, floor))


def test_all_dictionaries_of_opencv_and_no_other() -> None:
    known = {name.lower(): getattr(cv2.aruco, name) for name in dir(cv2.aruco) if name.startswith("DICT_")}
    assert {name.lower() for name in DICTIONARIES} == known.keys()
    for name, count in DICTIONARIES.items():
        assert len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name)).bytesList) == count


def test_a_marker_that_the_dictionary_lacks_is_told_with_its_file(scenes: Path) -> None:
    file = next((scenes / "boards").glob("*01-02.csv"))
    replace_in(file, "1,2", "1,50")
    rule = (
        r"01-02.csv: marker id = 50: must be from 0 to 49 in DICT_4X4_50, the cell file's boards.dictionary"
    )
    with pytest.raises(InputError, match=rule):
        read_cell(scenes / "cell.toml")


class Folder:
    """Photographs that were taken already."""

    def __init__(self, images: list[Image]) -> None:
        self.images = images

    def grab(self, count: int) -> list[Image]:
        return self.images[:count]


@pytest.mark.few(1)
@pytest.mark.parametrize("dictionary", ["DICT_6X6_250", "DICT_APRILTAG_36h11"])
def test_a_look_with_boards_of_any_dictionary(scenes: Path, dictionary: str) -> None:
    """From the key in the cell file to the pose in the look file."""
    replace_in(scenes / "cell.toml", '"DICT_4X4_50"', f'"{dictionary}"')
    replace_in(scenes / "cell.toml", "photographs = 5", "photographs = 1")
    task = read_task(scenes / "task2.toml")
    board, T = task.boards[0], random_pose(np.random.default_rng(3), 7.0)
    shot = photograph(lab_camera(), [(board, T)], np.random.default_rng(3), dictionary=dictionary)
    seen = look_and_save(task, Folder(shot.images), None, Console(True), "at it")
    file = scenes / "look.json"
    file.write_text(canonical_json(observation_to_json(seen, task.cell.camera)))
    (found,) = read_observation(file, task.cell).boards
    xi = twist_between(found.pose.T_base_board, T)
    assert np.linalg.norm(xi[:3]) < 0.3e-3
    assert np.linalg.norm(xi[3:]) < np.radians(0.15)
    assert np.degrees(found.pose.tilt_hypothesis.nearest) == pytest.approx(7.0)
    assert found.pose.tilt_hypothesis.fits
    if dictionary == "DICT_6X6_250":
        replace_in(scenes / "cell.toml", "# least_certain_deg = 1.0", "least_certain_deg = 0.01")
        with pytest.raises(ImpossibleError, match="too uncertain to grasp"):
            look_and_save(read_task(scenes / "task2.toml"), Folder(shot.images), None, Console(True), "at it")
