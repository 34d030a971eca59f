"""Guided views before a camera."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from arm.errors import CalibrationRefused, CameraError, InputError
from arm.io.storage import data_file
from calib.camera.result import CalibrationLimits
from cell.commands.calibration.camera_live import take_views
from cell.console import Console
from pictures.boards import lab_camera, smaller
from typed.command_line import a465
from vision.camera.frame_source import Image, read_grey
from vision.camera.model import write_camera
from vision.targets.target import Target

pytestmark = pytest.mark.xdist_group("calibrate_camera")

VIEWS = 1  # the session needs one


@pytest.fixture(scope="module")
def scenes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The lab's scenes with a camera of half as many pixels: four times as fast."""
    folder = tmp_path_factory.mktemp("lens")
    shutil.copytree(data_file("scenes"), folder / "scenes")
    write_camera(folder / "scenes/cameras/lab.toml", smaller(lab_camera(), 0.5))
    return folder / "scenes"


@pytest.fixture(scope="module")
def photographs(scenes: Path) -> Path:
    """Of a target before that camera."""
    folder = scenes.parent / "photographs"
    a465("render", scenes / "task2.toml", "--target", "charuco", "--count", VIEWS, "--seed", 3, "-o", folder)
    return folder


@pytest.mark.slow
def test_guided_views_are_enough_and_a_session_goes_on(scenes: Path, tmp_path: Path) -> None:
    folder = tmp_path / "live"
    common = ("calibrate", "camera", folder, "--live", "--simulated", scenes / "task2.toml")
    said, _ = a465(*common, "-o", tmp_path / "camera.toml")
    assert "show the target in the middle of the image, tilted some 30 deg with its left edge nearer" in said
    assert "the views suffice" in said
    assert "accepted" in said
    taken = sorted(folder.iterdir())
    assert 8 <= len(taken) <= 20
    taken[-1].unlink()  # it is taken again
    said, _ = a465(*common)
    assert f"{len(taken) - 1} views found in the folder" in said
    assert "the views suffice" in said
    assert (folder / taken[3].name).exists()


class Nobody:
    """A camera before which nobody stands, after `views` whose second frame is the same; a frame takes a second."""

    def __init__(self, views: list[Image]) -> None:
        self._left = [views[0]] + [view for view in views for _ in range(2)] if views else []
        self.now = 0.0

    def grab(self, count: int) -> list[Image]:
        self.now += count
        return [self._left.pop(0) if self._left else np.full((600, 960), 90, np.uint8) for _ in range(count)]


def test_a_session_without_anybody_ends(photographs: Path, tmp_path: Path, capsys) -> None:
    def session(folder: Path, views: list[Image], target: Target | None = None) -> int:
        console = Console(as_json=True)
        camera, limits = Nobody(views), CalibrationLimits()
        try:
            return take_views(
                folder, target or Target(), camera, None, None, limits, console, 5.0, lambda: camera.now
            )
        finally:
            assert camera.now <= 1.0 + 2.0 * len(views) + 6.0

    with pytest.raises(
        CalibrationRefused, match=r"no view of the target in 5 s; is it the one of the target file"
    ):
        session(tmp_path / "none", [])
    assert not list((tmp_path / "none").iterdir())
    assert session(tmp_path / "one", [read_grey(photographs / "target-001.png")]) == 1
    assert "no new view for 5 s: continuing with 1" in capsys.readouterr().err
    assert [p.name for p in (tmp_path / "one").iterdir()] == ["live-001.png"]
    with pytest.raises(InputError, match=r"shows more than the target .* needs squares = \[7, 5\]"):
        session(tmp_path / "part", [read_grey(photographs / "target-001.png")], Target(rows=3))
    assert not list((tmp_path / "part").iterdir())


def test_a_recording_ends_a_session_with_the_views_it_gave(
    photographs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    class Recording(Nobody):
        def grab(self, count: int) -> list[Image]:
            if not self._left:
                raise CameraError("video:clip.mp4", "ended", "the recording has no more frames")
            return super().grab(count)

    views = [read_grey(photographs / "target-001.png")]
    limits = CalibrationLimits()
    sizes: list[tuple[int, int]] = []
    one = tmp_path / "one", Target(), Recording(views), None, None, limits, Console(True)
    assert take_views(*one, region=sizes.append) == 1
    assert sizes == [(960, 600)]
    assert "the recording is at its end: continuing with 1" in capsys.readouterr().err
    empty = np.full((600, 960), 90, np.uint8)
    with pytest.raises(CameraError, match="the recording has no more frames"):
        take_views(tmp_path / "none", Target(), Recording([empty]), None, None, limits, Console(True))
