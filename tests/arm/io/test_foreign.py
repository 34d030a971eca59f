"""What belongs elsewhere is told as what it is, and what belongs there is not taken for it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import FileInputError
from arm.io.foreign import binary, markup, table, yaml
from arm.io.storage import data_file, read_json, read_text
from arm.io.toml_reader import read_toml
from arm.plan_file import read_plan


@pytest.mark.parametrize("suffix", ["png", "jpg", "bmp", "tiff"])
def test_images_are_told(tmp_path: Path, suffix: str) -> None:
    file = tmp_path / f"picture.{suffix}"
    cv2.imwrite(str(file), np.full((4, 4), 128, np.uint8))
    for read in (read_text, read_json, read_toml):
        with pytest.raises(FileInputError, match=r"is a \w+ image; a (text|JSON|TOML) file belongs here$"):
            read(file)


def test_a_large_image_is_told_as_one_and_not_by_its_size(tmp_path: Path) -> None:
    file = tmp_path / "picture.png"
    cv2.imwrite(str(file), np.random.default_rng(0).integers(0, 255, (1500, 2000), dtype=np.uint8))
    assert file.stat().st_size > 2_500_000
    with pytest.raises(FileInputError, match=r"is a PNG image; a (JSON|TOML) file belongs here$"):
        read_toml(file)


def test_arrays_and_archives_are_told(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros(3))
    np.savez(tmp_path / "b.npz", x=np.zeros(3))
    with pytest.raises(FileInputError, match="is a NumPy array; a TOML"):
        read_toml(tmp_path / "a.npy")
    with pytest.raises(FileInputError, match=r"is a ZIP archive, such as an \.npz file"):
        read_json(tmp_path / "b.npz")
    (tmp_path / "c.npz").write_bytes(b"PK\x03\x04" + bytes(100))  # UTF-8 by chance
    with pytest.raises(FileInputError, match="is a ZIP archive"):
        read_toml(tmp_path / "c.npz")


def test_a_table_of_numbers_is_told_where_toml_or_json_belongs() -> None:
    board = data_file("scenes/boards/positions_plate_01-02.csv")
    with pytest.raises(
        FileInputError, match=r"is a table of numbers \(CSV\), .*, and a TOML file belongs here"
    ):
        read_toml(board)
    with pytest.raises(
        FileInputError, match=r"is a table of numbers \(CSV\), .*, and a JSON file belongs here"
    ):
        read_json(board)


def test_every_file_of_the_project_is_what_it_is() -> None:
    for file in data_file("scenes").rglob("*.toml"):
        text = file.read_text()
        assert [binary(file.read_bytes()), markup(text), table(text), yaml(text)] == [""] * 4, file


def test_numbers_alone_are_a_table_and_words_between_them_are_none() -> None:
    assert table("1,2\n-3.5;4e-3\n# of Monday\n5 6\n")
    for text in ("1,2\n3,4\n", "a = 1\nb = 2\nc = 3\n", "1\n2\n3\n", "[1, 2]\n[3, 4]\n[5, 6]\n"):
        assert not table(text)


def test_what_a_command_printed_is_told(tmp_path: Path) -> None:
    (tmp_path / "look.json").write_text("hole    x mm  state\n------  ----- -----\n01-02/1  5.0  cube\n")
    with pytest.raises(
        FileInputError, match=r"is the table that a command printed \(-o FILE writes the file\)"
    ):
        read_json(tmp_path / "look.json")
    (tmp_path / "plan.json").write_text('{"plan": "p.json", "plan_sha256": "1", "moves": []}')
    with pytest.raises(
        FileInputError, match=r"is what plan --json printed, and a plan belongs here \(plan -o"
    ):
        read_plan(tmp_path / "plan.json")
