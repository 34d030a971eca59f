"""Photographs in a folder: sets that are whole, of one moment, under names that increase, and not for ever."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from arm.errors import ExecutionStopped, InputError
from cell.sim.photo_folder import FolderCamera


class Cell:
    """Arm, jaws and camera, as far as they matter here; the camera is a grey level, told by `level`."""

    def __init__(self) -> None:
        self.arm, self.level, self.busy = 0, 0, False
        self.history = [0]
        self.cell = SimpleNamespace(photographs=2)
        self.machine = self
        self.during: Any = lambda: None

    def counts(self) -> tuple[int, ...]:
        return (self.arm,)

    def grab(self, count: int) -> list[Any]:
        image = np.full((4, 4), self.level, dtype=np.uint8)
        self.during()
        return [image] * count


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Wall time as the camera sees it."""
    now = SimpleNamespace(s=100.0)
    monkeypatch.setattr("cell.sim.photo_folder.time.monotonic", lambda: now.s)
    return now


def _camera(cell: Any, folder: Path) -> FolderCamera:
    return FolderCamera(cell, cell, cell, folder)


def _levels(folder: Path) -> dict[str, int]:
    names = sorted(p.name for p in folder.iterdir())
    return {name: int(cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)[0, 0]) for name in names}


def test_a_set_is_taken_when_the_arm_has_stood_a_while_and_then_every_few_seconds(
    tmp_path: Path, clock: SimpleNamespace
) -> None:
    cell = Cell()
    camera = _camera(cell, tmp_path / "shots")
    taken = []
    for tenth in range(200):
        clock.s = 100.0 + tenth / 10
        if tenth == 100:
            cell.arm, cell.busy = 1, True  # it moves for 3 s
        if tenth == 130:
            cell.arm, cell.busy = 2, False
        if camera.poll():
            taken.append(tenth / 10)
    assert taken == pytest.approx([1.0, 6.0, 14.0, 19.0], abs=0.11)


def test_what_moved_while_it_was_photographed_is_not_shown(tmp_path: Path, clock: SimpleNamespace) -> None:
    cell = Cell()
    camera = _camera(cell, tmp_path)

    def arm() -> None:
        cell.arm += 1

    def jaws() -> None:
        cell.history.append(0)

    def motion() -> None:
        cell.busy = True

    for cell.during in (arm, jaws, motion):
        camera.poll()
        clock.s += 10.0
        assert not camera.poll()
        assert not list(tmp_path.iterdir())
        cell.busy = False
    cell.during = lambda: None
    camera.poll()
    clock.s += 10.0
    assert camera.poll()
    assert len(list(tmp_path.iterdir())) == 2


def test_sets_come_whole_under_later_names_and_old_ones_go(tmp_path: Path, clock: SimpleNamespace) -> None:
    cv2.imwrite(str(tmp_path / "mine.png"), np.zeros((4, 4), dtype=np.uint8))
    cv2.imwrite(str(tmp_path / "emulated-000041.png"), np.zeros((4, 4), dtype=np.uint8))
    cell, seen = Cell(), []
    cell.during = lambda: seen.append(sorted(p.suffix for p in tmp_path.iterdir()))
    camera = _camera(cell, tmp_path)
    for cell.level in (10, 20, 30, 40):
        camera.poll()
        clock.s += 10.0
        assert camera.poll()
    assert _levels(tmp_path) == {
        "emulated-000044.png": 20, "emulated-000045.png": 20, "emulated-000046.png": 30,
        "emulated-000047.png": 30, "emulated-000048.png": 40, "emulated-000049.png": 40, "mine.png": 0,
    }  # fmt: skip
    assert [len(suffixes) for suffixes in seen] == [1, 3, 5, 7]
    assert {suffix for suffixes in seen for suffix in suffixes} == {".png"}


def test_sets_of_an_earlier_emulator_are_gone_before_the_first_of_this_one(tmp_path: Path) -> None:
    for name in ("emulated-000003.png", "emulated-000004.png", "mine.png", "emulated-3.txt"):
        (tmp_path / name).touch()
    _camera(Cell(), tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["emulated-3.txt", "mine.png"]


def test_nothing_is_ever_half_there(
    tmp_path: Path, clock: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, before = Cell(), []
    camera = _camera(cell, tmp_path)
    replace = os.replace

    def watched(part: Path, file: Path) -> None:
        before.append((part.suffix, cv2.imread(str(file)), part.stat().st_size))
        replace(part, file)

    monkeypatch.setattr(os, "replace", watched)
    camera.poll()
    clock.s += 10.0
    assert camera.poll()
    assert [(suffix.startswith(".a465-"), there) for suffix, there, _ in before] == [(True, None)] * 2
    assert [p.stat().st_size for p in sorted(tmp_path.iterdir())] == [size for _, _, size in before]


def test_a_folder_that_is_none_or_goes_away_is_told(tmp_path: Path, clock: SimpleNamespace) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="file: cannot be created"):
        _camera(Cell(), tmp_path / "file")
    camera = _camera(Cell(), tmp_path / "shots")
    (tmp_path / "shots").rmdir()
    camera.poll()
    clock.s += 10.0
    with pytest.raises(ExecutionStopped, match="shots: images cannot be written: No such file"):
        camera.poll()
