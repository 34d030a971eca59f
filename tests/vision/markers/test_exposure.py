"""Photographs that are too bright or too dark are told; of good ones nothing is said."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from cell.scene.bodies import plate_body
from pictures.boards import TABLE, lab_board, lab_camera, leaning
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Image
from vision.markers.detect import detect_markers
from vision.markers.exposure import exposure_complaint


@pytest.fixture(scope="module")
def clean() -> Image:
    board, T_base_board = lab_board(), leaning((0.44, -0.01, 0.05), 30.0, 7.0, 40.0)
    bodies = [TABLE, plate_body(board.name, T_base_board)]
    return render(lab_camera(), bodies, [PlacedBoard(board, T_base_board)], "DICT_4X4_50")


def exposed(clean: Image, factor: float) -> Image:
    bright = np.clip(np.rint(factor * clean.astype(float)), 0, 255).astype(np.uint8)
    return with_noise(bright, np.random.default_rng(0), 2.0)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (0.1, "too dark: marker"),
        (0.6, None),
        (1.0, None),
        (1.05, None),
        (1.3, "of the white of marker"),
        (3.0, "is saturated, which shifts corners; reduce exposure or gain"),
    ],
)
def test_exposure_is_judged_by_the_markers(clean: Image, factor: float, told: str | None) -> None:
    image = exposed(clean, factor)
    markers = detect_markers(image, lab_camera())
    assert {m.id for m in markers} >= set(lab_board().marker_ids)
    complaint = exposure_complaint(image, markers)
    assert complaint is None if told is None else told in (complaint or "")
    coloured = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    assert exposure_complaint(coloured, markers) == complaint
    coloured[..., 0] = 255  # of one channel alone nobody measures corners
    if told is None:
        assert exposure_complaint(coloured, markers) is None


def test_the_worst_marker_is_named(clean: Image) -> None:
    image = exposed(clean, 1.0)
    markers = [m for m in detect_markers(image, lab_camera()) if m.id in lab_board().marker_ids]
    middle = [np.rint(m.corners_px.mean(axis=0)).astype(int) for m in markers]
    for (x, y), brightness in zip(middle, (255, 0), strict=True):
        part = image[y - 150 : y + 150, x - 150 : x + 150]
        part[part > 120] = brightness if brightness else 40
    assert f"100 % of the white of marker {markers[0].id} is saturated" in str(
        exposure_complaint(image, markers)
    )
    assert f"too dark: marker {markers[1].id} has 40 grey" in str(exposure_complaint(image, markers[1:]))


def test_markers_at_the_rim_and_none(clean: Image) -> None:
    image = exposed(clean, 1.0)
    marker = next(m for m in detect_markers(image, lab_camera()) if m.id in lab_board().marker_ids)
    x, y = np.rint(marker.corners_px.min(axis=0)).astype(int)
    cut = image[y + 5 :, x + 5 :]  # a part of it is outside
    moved = type(marker)(marker.id, marker.corners_px - (x + 5, y + 5), marker.method)
    assert exposure_complaint(cut, [moved]) is None
    assert exposure_complaint(image, []) is None
