"""Images of now beside those that are there, or a refusal that leaves the folder as it is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import cell.commands.manual.snap
from arm.errors import CameraError
from cell.files.task import read_task
from cell.session.connection import camera_at_start
from tasks.small import small_scenes
from typed.command_line import a465
from vision.camera.model import Image

from .conftest import CELL


class _Camera:
    def __init__(self, images: list[Image]) -> None:
        self.images = images

    def grab(self, count: int) -> list[Image]:
        if not self.images:
            raise CameraError("x", "silent", "delivers no image")
        return [self.images[k % len(self.images)] for k in range(count)]


def _give(monkeypatch: pytest.MonkeyPatch, *images: Image) -> None:
    @contextmanager
    def opened(*_: Any) -> Iterator[_Camera]:
        yield _Camera(list(images))

    monkeypatch.setattr(cell.commands.manual.snap, "open_camera", opened)


def _grey(value: int) -> Image:
    return np.full((1200, 1920), value, dtype=np.uint8)


def test_images_are_added_to_those_that_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    _give(monkeypatch, _grey(10), _grey(20))
    said, _ = a465("snap", CELL, "-o", "seen", "--camera", "name:a", "--count", 2)
    assert "2 images in seen: image-0001.png to image-0002.png" in said
    assert "mean grey 10 of 255; markers none" in said
    Path("seen/other.png").write_text("")
    _give(monkeypatch, _grey(30))
    told = json.loads(a465("snap", CELL, "-o", "seen", "--camera", "name:a", "--count", 1, "--json")[0])
    assert told["files"] == ["seen/image-0003.png"]
    values = [int(cv2.imread(f"seen/image-000{k}.png", cv2.IMREAD_UNCHANGED)[0, 0]) for k in (1, 2, 3)]
    assert values == [10, 20, 30]


def test_a_look_takes_as_many_and_markers_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scenes = small_scenes(tmp_path)
    task = read_task(scenes / "task2.toml")
    (image,) = camera_at_start(task, None).grab(1)
    _give(monkeypatch, image)
    told = json.loads(a465("snap", scenes / "task2.toml", "-o", "seen", "--camera", "name:a", "--json")[0])
    assert len(told["files"]) == task.cell.photographs
    assert {1, 2, 3, 4} <= set(told["markers"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("-o", "seen"), "names no camera"),
        (("-o", "seen", "--camera", "colour:red"), "colour"),
        (("-o", "seen", "--camera", "name:a", "--count", "0"), "--count 0: must be from 1 to 1000"),
        (("-o", "file", "--camera", "name:a"), "file: is not a folder"),
    ],
)
def test_what_cannot_be_is_refused(options: tuple[str, ...], words: str) -> None:
    Path("file").write_text("")
    _, told = a465("snap", CELL, *options, code=2)
    assert words in told
    assert not Path("seen").exists()


def test_a_camera_without_images_leaves_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    _give(monkeypatch)
    _, told = a465("snap", CELL, "-o", "seen", "--camera", "name:a", code=2)
    assert "no photographs: camera x: delivers no image" in told
    assert not Path("seen").exists()
