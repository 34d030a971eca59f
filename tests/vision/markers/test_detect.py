"""Marker corners on rendered photographs against the exact projection."""

from __future__ import annotations

import time

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import Array, apply
from cell.config.board_keys import DICTIONARIES
from pictures.boards import lab_board, lab_camera, leaning, photograph, random_pose, window
from vision.camera.model import Camera, Image
from vision.markers.detect import detect_markers


def one_marker(
    seed: int, tilt_deg: float, noise: float = 2.0, size: float = 0.036, dictionary: str = "DICT_4X4_50"
) -> tuple[Image, Camera, Array]:
    """A photograph of the lower marker alone, the camera that took it, and the true corners (4, 2) px."""
    rng = np.random.default_rng(seed)
    board, T = lab_board(marker_size=size), random_pose(rng, tilt_deg)
    corners = apply(T, board.marker_corners()[0])
    whole = lab_camera()
    low = np.floor(whole.project_base(corners).min(axis=0) - 60.0)
    high = np.ceil(whole.project_base(corners).max(axis=0) + 60.0)
    camera = window(whole, low, (int(high[0] - low[0]), int(high[1] - low[1])))
    shot = photograph(camera, [(board, T)], rng, noise=noise, dictionary=dictionary)
    return shot.images[0], camera, camera.project_base(corners)


def test_corners_by_border_lines() -> None:
    """The issue's figure, 0.02 px rms and 0.005 px bias. Of the 0.013 px seen most is the renderer's own."""
    errors, truths = [], []
    for seed in range(30):
        image, camera, truth = one_marker(seed, 0.5 * seed, size=0.040)  # 0 to 14.5 deg
        (marker,) = detect_markers(image, camera)
        assert (marker.id, marker.method) == (1, "lines")
        errors.append(marker.corners_px - truth)
        truths.append(truth - truth.mean(axis=0))
    error, outward = np.array(errors), np.array(truths)
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert np.abs(error.mean(axis=(0, 1))).max() < 0.005
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    assert abs((error * outward).sum(axis=-1).mean()) < 0.005


def test_four_markers_take_less_than_30_ms() -> None:
    """Processor time of one thread, the least of several: what else the host does is not counted."""
    camera, rng = lab_camera(), np.random.default_rng(1)
    boards = [
        (lab_board("01-02", 0.040), leaning((0.46, 0.11, 0.04), 175.0, 7.0, 265.0)),
        (lab_board("03-04", 0.040), leaning((0.46, -0.13, 0.09), 90.0, 15.0, 270.0)),
    ]
    image = photograph(camera, boards, rng).images[0]
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        took = []
        for _ in range(8):
            started = time.process_time()
            markers = detect_markers(image, camera)
            took.append(time.process_time() - started)
    finally:
        cv2.setNumThreads(threads)
    assert [(m.id, m.method) for m in markers] == [(i, "lines") for i in (1, 2, 3, 4)]
    assert min(took) < 0.030


@pytest.mark.parametrize("dictionary", DICTIONARIES)
def test_every_dictionary(dictionary: str) -> None:
    """Right id, and corners in the order in which the marker is printed."""
    image, camera, truth = one_marker(2, 7.0, dictionary=dictionary)
    (marker,) = detect_markers(image, camera, dictionary)
    assert (marker.id, marker.method) == (1, "lines")
    assert np.abs(marker.corners_px - truth).max() < 0.06


def test_subpix_is_what_it_says_and_worse() -> None:
    """A side that is mostly hidden has no line; the corners then come from cornerSubPix, and the marker says so."""
    image, camera, truth = one_marker(3, 7.0)
    covered = image.copy()
    a, b = truth[0], truth[1]
    for t in np.linspace(0.15, 0.7, 60):
        cv2.circle(covered, tuple(np.rint(a + t * (b - a)).astype(int).tolist()), 5, 20, -1)
    markers = detect_markers(covered, camera)
    assert [m.method for m in markers] == ["subpix"]
    assert 0.03 < np.sqrt(np.mean((markers[0].corners_px - truth) ** 2)) < 1.0


def test_a_short_covered_stretch_does_not_move_the_line() -> None:
    image, camera, truth = one_marker(4, 7.0)
    middle = truth[:2].mean(axis=0)
    cv2.circle(image, tuple(np.rint(middle).astype(int).tolist()), 8, 20, -1)
    (marker,) = detect_markers(image, camera)
    assert marker.method == "lines"
    assert np.abs(marker.corners_px - truth).max() < 0.05


def test_whole_photograph_is_searched_small_and_measured_large() -> None:
    rng = np.random.default_rng(5)
    camera, board = lab_camera(), lab_board()
    T = random_pose(rng, 7.0)
    image = photograph(camera, [(board, T)], rng).images[0]
    started = time.process_time()
    markers = detect_markers(image, camera)
    assert time.process_time() - started < 0.2
    assert [m.id for m in markers] == [1, 2]
    truth = camera.project_base(apply(T, board.marker_corners()))
    assert np.abs(np.stack([m.corners_px for m in markers]) - truth).max() < 0.04
    colour = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)
    for grey_marker, colour_marker in zip(markers, detect_markers(colour, camera), strict=True):
        assert np.abs(grey_marker.corners_px - colour_marker.corners_px).max() < 1e-9


@pytest.mark.parametrize("noise", [0.0, 6.0])
def test_noise_and_its_absence(noise: float) -> None:
    image, camera, truth = one_marker(7, 15.0, noise)
    (marker,) = detect_markers(image, camera)
    assert np.abs(marker.corners_px - truth).max() < 0.06


def test_nothing_to_see() -> None:
    assert detect_markers(np.full((1200, 1920), 128, np.uint8), lab_camera()) == []


def test_bad_input() -> None:
    with pytest.raises(InputError, match=r"dictionary = 'DICT_4X4': must be one of .*DICT_4X4_50"):
        detect_markers(np.zeros((1200, 1920), np.uint8), lab_camera(), "DICT_4X4")
    with pytest.raises(InputError, match="1000 x 500 px, but the camera's calibration is for 1920 x 1200"):
        detect_markers(np.zeros((500, 1000), np.uint8), lab_camera())
