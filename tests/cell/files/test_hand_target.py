"""The file of a target in the hand."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.files.hand_target import read_hand_target
from typed.command_line import replace_in

HAND = data_file("scenes/targets/hand.toml")


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("plate_mm = [108, 84, 4]", "plate_mm = [70, 84, 4]", "plate_mm"),
        ("centre_mm = [110, 0, 100]", "centre_mm = [110, 0]", "centre_mm"),
        ("[hand]", "[foot]", "hand"),
        ("square_mm = 12 ", "square_mm = 8 ", "marker_mm"),
    ],
)
def test_a_wrong_target_file_is_told_by_its_key(tmp_path: Path, old: str, new: str, key: str) -> None:
    path = tmp_path / "hand.toml"
    shutil.copy(HAND, path)
    path.chmod(0o644)
    replace_in(path, old, new)
    with pytest.raises(InputError) as told:
        read_hand_target(path)
    assert key in told.value.data["key"]
