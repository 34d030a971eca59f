"""A cell's camera: what contradicts its lens, its other keys or OpenCV's names is refused where it is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from arm.errors import FileInputError
from cell.config.cell_file import read_cell
from typed.command_line import replace_in

_TABLE = "# [look.basler]  "


def _with(scenes: Path, table: str) -> Path:
    file = scenes / "cell.toml"
    replace_in(file, _TABLE, f"{table}\n{_TABLE}")
    return file


@pytest.mark.parametrize(
    ("table", "told"),
    [
        (
            '[look.video]\ndevice = "video:0"\nsize_px = [1280, 720]',
            "look.video.size_px = [1280, 720]: must be of images of 1920 x 1200 px, those of the camera file",
        ),
        (
            '[look.video]\ndevice = "video:0@1280x720"',
            "look.video.device = 'video:0@1280x720': must be of images of 1920 x 1200 px",
        ),
        ("[look.video]\nfeatures = { CAP_PROP_FOCUS = 30 }", "without CAP_PROP_ (did you mean FOCUS?)"),
        ("[look.video]\nfeatures = { focus = 30 }", "OpenCV has no such property; .*(did you mean FOCUS?)"),
        ('[look.video]\nfeatures = { FOURCC = "MJPEG" }', "four letters such as"),
        (
            "[look.basler]\nexposure_us = 8000\nfeatures = { ExposureTimeAbs = 9000 }",
            "has ExposureTimeAbs, and look.basler.exposure_us sets it (give one)",
        ),
        ('[look.basler]\nfeatures = { TriggerMode = "Off" }', "has TriggerMode, which a465 itself sets"),
        ('[look.camera]\ndevice = "name:a"', "is not a known key (known: basler, "),
    ],
)
def test_what_contradicts_is_refused(scenes: Path, table: str, told: str) -> None:
    with pytest.raises(FileInputError) as caught:
        read_cell(_with(scenes, table))
    for part in told.split(".*"):
        assert part in str(caught.value)


def test_what_agrees_is_read(scenes: Path) -> None:
    camera = read_cell(
        _with(
            scenes,
            '[look.video]\ndevice = "video:0@1920x1200"\nfeatures = { FOURCC = "YUYV", AUTOFOCUS = 0 }\n'
            "[look.basler]\nfeatures = { ReverseX = false, ExposureTime = 9000 }",
        )
    ).live_camera
    assert camera.device == "video:0@1920x1200"


@pytest.mark.parametrize(
    ("named", "table"),
    [
        ("name:camera-crs93", "look.basler"),
        ("21923415", "look.basler"),
        ("video:0", "look.video"),
        ("/dev/video0", "look.video"),
    ],
)
def test_a_device_in_place_of_the_camera_file_is_sent_to_its_table(
    scenes: Path, named: str, table: str
) -> None:
    file = scenes / "cell.toml"
    replace_in(file, '"cameras/lab.toml"', f'"{named}"')
    with pytest.raises(
        FileInputError, match=rf"must be a camera file.*a camera itself is device in \[{table}\]"
    ):
        read_cell(file)
