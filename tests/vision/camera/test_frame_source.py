"""Photographs from a folder: in order, each once, and refused where they cannot be had."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from vision.camera.frame_source import FrameSource, ImageFolder, _of_libraries, read_grey


def folder(path: Path, count: int, size: tuple[int, int] = (8, 6)) -> Path:
    path.mkdir(exist_ok=True)
    for i in range(count):
        cv2.imwrite(str(path / f"shot_{i:02d}.png"), np.full((size[1], size[0]), 10 * i, np.uint8))
    return path


def test_in_order_of_names_and_each_once(tmp_path: Path) -> None:
    source: FrameSource = ImageFolder(folder(tmp_path, 5))
    (tmp_path / "notes.txt").write_text("no photograph")
    assert [int(i[0, 0]) for i in source.grab(2)] == [0, 10]
    assert [int(i[0, 0]) for i in source.grab(2)] == [20, 30]
    with pytest.raises(InputError, match=r"has 1 new images \(4 were used before\), but 2"):
        source.grab(2)


def test_photographs_that_arrive_later_are_found(tmp_path: Path) -> None:
    source = ImageFolder(folder(tmp_path, 1))
    source.grab(1)
    folder(tmp_path, 2)
    assert int(source.grab(1)[0][0, 0]) == 10


def test_a_failed_grab_uses_nothing_up(tmp_path: Path) -> None:
    source = ImageFolder(folder(tmp_path, 2))
    (tmp_path / "shot_02.png").write_bytes(b"not an image")
    with pytest.raises(InputError, match=r"shot_02\.png: cannot be read as an image"):
        source.grab(3)
    assert len(source.grab(2)) == 2


def test_missing_folder_and_mixed_sizes(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        ImageFolder(tmp_path / "nowhere")
    source = ImageFolder(folder(tmp_path, 2))
    cv2.imwrite(str(tmp_path / "shot_01.png"), np.zeros((6, 9), np.uint8))
    with pytest.raises(InputError, match=r"shot_01\.png: is 9 x 6 px, but shot_00\.png is 8 x 6"):
        source.grab(2)


@pytest.mark.parametrize(
    ("suffix", "words"), [("png", "(libpng error: "), ("jpg", "(Corrupt JPEG data: premature end")]
)
def test_a_damaged_photograph_is_refused_and_the_libraries_say_nothing(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], suffix: str, words: str
) -> None:
    file = tmp_path / f"a.{suffix}"
    rng = np.random.default_rng(3)
    cv2.imwrite(str(file), rng.integers(0, 256, (400, 400), dtype=np.uint8))
    read_grey(file)
    data = bytearray(file.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 100] = b"\xff\xd8" * 50
    file.write_bytes(data)
    with pytest.raises(InputError) as refused:
        read_grey(file)
    assert f"{file}: cannot be read as an image: the file is damaged {words}" in str(refused.value)
    assert capfd.readouterr().err == ""


def test_what_others_write_to_standard_error_meanwhile_is_kept(capfd: pytest.CaptureFixture[str]) -> None:
    said: list[str] = []
    with _of_libraries(said):
        os.write(2, b"a465: stopped\nlibpng warning: of no weight\n")
    assert said == ["libpng warning: of no weight"]
    assert capfd.readouterr().err == "a465: stopped\n"


def test_an_image_in_place_of_its_folder_is_told(tmp_path: Path) -> None:
    folder(tmp_path, 1)
    with pytest.raises(InputError, match=r"shot_00\.png: is a file; give the folder that it is in"):
        ImageFolder(tmp_path / "shot_00.png")
    with pytest.raises(InputError, match=r"lab\.toml: is a camera file; give a folder of images"):
        ImageFolder(data_file("scenes/cameras/lab.toml"))


def test_images_one_folder_further_down_are_named(tmp_path: Path) -> None:
    (tmp_path / "notes").mkdir()
    with pytest.raises(InputError, match=r"\.pgm$"):
        ImageFolder(tmp_path).grab(1)
    for day in ("2026-11-27", "2026-11-28"):
        (tmp_path / day).mkdir()
        cv2.imwrite(str(tmp_path / day / "a.png"), np.zeros((4, 6), np.uint8))
    told = (
        rf"; are the images those of {tmp_path}/2026-11-28, one of 2 such folders in it\? give that folder$"
    )
    with pytest.raises(InputError, match=told):
        ImageFolder(tmp_path).grab(1)
    cv2.imwrite(str(tmp_path / "b.png"), np.zeros((4, 6), np.uint8))
    with pytest.raises(InputError, match=r"has 1 new images, but 2 are needed; .*\.pgm$"):
        ImageFolder(tmp_path).grab(2)


@pytest.mark.parametrize("form", ["zip", "tar", "gztar", "bztar", "xztar"])
def test_an_archive_of_images_is_told(tmp_path: Path, form: str) -> None:
    file = Path(shutil.make_archive(str(tmp_path / "photos"), form, folder(tmp_path / "seen", 2)))
    what = {"zip": "ZIP", "tar": "tar", "gztar": "gzip", "bztar": "bzip2", "xztar": "xz"}[form]
    rule = rf"{file.name}: is an? {what} archive; unpack it, and give the folder$"
    with pytest.raises(InputError, match=rule):
        ImageFolder(file)
