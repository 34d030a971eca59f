"""Whether an image is sharp and exposed is judged by its markers, and said in figures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from arm.io.storage import data_file
from cell.config.cell import Cell
from cell.config.cell_file import read_cell
from cell.doctor.sharpness import judge_image
from cell.files.task import read_task
from cell.session.connection import camera_at_start
from vision.camera.model import Image

pytestmark = pytest.mark.xdist_group("doctor")


@pytest.fixture(scope="module")
def seen() -> Image:
    (image,) = camera_at_start(read_task(data_file("scenes/task2.toml")), None).grab(1)
    return image


@pytest.fixture(scope="module")
def cell() -> Cell:
    return read_cell(data_file("scenes/cell.toml"))


def test_a_good_image_has_its_figures(seen: Image, cell: Cell) -> None:
    found = judge_image(seen, cell)
    assert found.complaint == ""
    assert found.markers == (1, 2, 3, 4)
    assert found.blur_px is not None
    assert 0.4 < found.blur_px < 1.2
    assert judge_image(np.asarray(cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), np.uint8), cell) == found


@pytest.mark.parametrize(
    ("factor", "blur_px", "told"),
    [
        (1.0, 2.0, "px, more than 1.5: focus, or expose for a shorter time"),
        (2.0, 0.0, "of the white of marker"),
        (0.12, 0.0, "too dark: marker"),
        (0.01, 0.0, "nothing brighter than"),
        (0.0, 0.0, "it shows nothing brighter than"),
    ],
)
def test_what_is_wrong_is_told(seen: Image, cell: Cell, factor: float, blur_px: float, told: str) -> None:
    image = np.clip(factor * seen.astype(float), 0, 255)
    if blur_px:
        image = cv2.GaussianBlur(image, (0, 0), blur_px)
    assert told in judge_image(image.astype(np.uint8), cell).complaint


def test_without_a_marker_nothing_is_known(cell: Cell) -> None:
    width, height = cell.camera.size
    found = judge_image(np.full((height, width), 120, np.uint8), cell)
    assert (found.markers, found.blur_px) == ((), None)
    assert found.complaint == "no marker is in view: put a board where the camera sees it"
