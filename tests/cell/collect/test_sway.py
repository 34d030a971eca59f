"""The camera's sway while a target is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from cell.collect.sway import Sway
from cell.config.cell_file import read_cell
from pictures.boards import lab_camera
from typed.command_line import replace_in
from typed.heard import Heard
from vision.camera.model import Image
from watched.scratched import scratched_table, turned


class Frames:
    """A camera that sees the images of a function of their number."""

    def __init__(self, image: Callable[[int], Image]) -> None:
        self.image = image

    def grab(self, count: int) -> list[Image]:
        return [self.image(number) for number in range(count)]


CAMERA, TABLE = lab_camera(), scratched_table()


def _begun(scenes: Path) -> Sway:
    sway = Sway(scenes / "recorded.background.npz", read_cell(scenes / "uncalibrated/cell.toml"), Heard())
    sway.begin(Frames(lambda number: TABLE.image(CAMERA, noise=1.0, seed=90 + number)))
    return sway


def _grey_off(a: Image, b: Image) -> float:
    inner = np.s_[60:-60, 60:-60]
    return float(np.abs(a[inner].astype(float) - b[inner]).max())


@pytest.mark.slow
def test_images_are_those_before_the_first_pose_also_in_a_continued_recording(scenes: Path) -> None:
    begun = _begun(scenes)
    first = TABLE.image(CAMERA, noise=1.0)
    swayed = TABLE.image(turned(CAMERA, (0.01, -0.006, 0.002)), noise=1.0, seed=1)
    assert _grey_off(first, swayed) > 20.0
    assert _grey_off(first, begun.steadied([swayed])[0]) < 12.0
    assert 1e3 * begun.largest == pytest.approx(0.25, abs=0.06)
    replace_in(scenes / "uncalibrated/camera.toml", "0.49509]", "0.49409]")
    later = Sway(begun.file, read_cell(scenes / "uncalibrated/cell.toml"), Heard())
    assert later.is_measured
    assert _grey_off(later.steadied([swayed])[0], begun.steadied([swayed])[0]) < 3.0


@pytest.mark.slow
def test_the_background_of_another_lens_is_refused(scenes: Path) -> None:
    begun = _begun(scenes)
    replace_in(scenes / "uncalibrated/camera.toml", "4746.48725", "4747.48725")
    with pytest.raises(InputError, match="another calibration of the camera"):
        Sway(begun.file, read_cell(scenes / "uncalibrated/cell.toml"), Heard())


def test_a_blank_table_leaves_images_as_they_are_and_this_is_told(scenes: Path) -> None:
    console = Heard()
    sway = Sway(scenes / "recorded.background.npz", read_cell(scenes / "uncalibrated/cell.toml"), console)
    blank = np.full_like(TABLE.image(CAMERA), 128)
    sway.begin(Frames(lambda _: blank))
    assert not sway.is_measured
    assert not sway.file.exists()
    assert "not measured, so it adds to the arm's scatter: the background shows 0 features" in console.all
    images = [TABLE.image(CAMERA)]
    assert sway.steadied(images) is images
    sway.report()
    assert len(console.told) == 1


def test_a_hidden_background_and_a_knocked_camera_are_told_apart(scenes: Path) -> None:
    sway = _begun(scenes)
    hidden = [np.full_like(TABLE.image(CAMERA), 128)]
    assert sway.steadied(hidden) is hidden
    assert sway.unseen == 1
    with pytest.raises(ImpossibleError, match="the camera moved by"):
        sway.steadied([TABLE.image(turned(CAMERA, (0.3, 0.0, 0.0)))])
    sway.report()
    assert "in 1 look the arm hid the background" in sway.console.all  # type: ignore[attr-defined]
