"""Blur is measured at the borders of markers, in the blurrier direction."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cell.scene.bodies import plate_body
from pictures.boards import TABLE, lab_board, lab_camera, leaning
from render.renderer import PlacedBoard, render, with_noise
from vision.camera.model import Image
from vision.markers.detect import detect_markers
from vision.markers.edge_blur import marker_blur

DICTIONARY = "DICT_4X4_50"


def photograph(psf_px: float) -> Image:
    board, T_base_board = lab_board(), leaning((0.44, -0.01, 0.05), 30.0, 7.0, 40.0)
    bodies = [TABLE, plate_body(board.name, T_base_board)]
    clean = render(lab_camera(), bodies, [PlacedBoard(board, T_base_board)], DICTIONARY, psf_px=psf_px)
    return with_noise(clean, np.random.default_rng(0), 2.0)


def blur_of(image: Image) -> float | None:
    return marker_blur(image, detect_markers(image, lab_camera()), DICTIONARY)


@pytest.mark.parametrize("psf_px", [0.7, 1.5, 3.0])
def test_the_blur_of_the_lens_is_measured(psf_px: float) -> None:
    # the pixel's own width adds to the lens's
    assert blur_of(photograph(psf_px)) == pytest.approx(np.hypot(psf_px, 0.5), rel=0.05)


def test_a_motion_counts_though_it_blurs_one_direction_only() -> None:
    sharp = photograph(0.7)
    moved = np.asarray(cv2.filter2D(sharp, -1, np.full((1, 9), 1 / 9)), dtype=np.uint8)
    assert (blur_of(moved) or 0.0) > 2.0 * (blur_of(sharp) or 9.0)


def test_nothing_is_said_without_markers_that_are_large_enough() -> None:
    assert blur_of(np.full((1200, 1920), 90, np.uint8)) is None
    sharp = photograph(0.7)
    markers = detect_markers(sharp, lab_camera())
    for factor, told in ((0.2, False), (0.5, True)):  # modules of 5 and 12 px
        reduced = cv2.resize(sharp, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        scaled = [replace(m, corners_px=factor * m.corners_px) for m in markers]
        assert (marker_blur(np.asarray(reduced, np.uint8), scaled, DICTIONARY) is not None) is told
