"""Marker corners on rendered photographs against the exact projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from arm.se3 import apply
from pictures.boards import lab_board, lab_camera, leaning, photograph, random_pose
from pictures.markers import one_marker
from render.renderer import with_noise
from timed.relative import relative_cost
from vision.markers.detect import detect_markers


def test_four_markers_are_measured_in_the_time_in_which_opencv_finds_them() -> None:
    """At most twice the processor time of OpenCV's own search in the whole image, which measures less exactly."""
    camera, rng = lab_camera(), np.random.default_rng(1)
    boards = [
        (lab_board("01-02", 0.040), leaning((0.46, 0.11, 0.04), 175.0, 7.0, 265.0)),
        (lab_board("03-04", 0.040), leaning((0.46, -0.13, 0.09), 90.0, 15.0, 270.0)),
    ]
    image = photograph(camera, boards, rng).images[0]
    assert [(m.id, m.method) for m in detect_markers(image, camera)] == [(i, "lines") for i in (1, 2, 3, 4)]
    own = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    cost = relative_cost(lambda: detect_markers(image, camera), lambda: own.detectMarkers(image), enough=2.0)
    assert cost < 2.0


def test_whole_photograph_is_searched_small_and_measured_large() -> None:
    rng = np.random.default_rng(5)
    camera, board = lab_camera(), lab_board()
    T = random_pose(rng, 7.0)
    image = photograph(camera, [(board, T)], rng).images[0]
    markers = detect_markers(image, camera)
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


def test_the_noise_of_corners_is_their_scatter_in_every_direction() -> None:
    """Corners are intersections of lines, and what moves a whole side scatters half as much as what turns it."""
    image, camera, _ = one_marker(1, 7.0, 0.0)
    rng = np.random.default_rng(1)
    found = [detect_markers(with_noise(image, rng, 6.0), camera)[0] for _ in range(60)]
    scatter = np.cov([marker.corners_px.ravel() for marker in found], rowvar=False)
    told = np.mean([marker.noise for marker in found if marker.noise is not None], axis=0)
    variances, directions = np.linalg.eigh(told)
    assert variances[4:].mean() > 3.0 * variances[:4].mean()
    ratios = np.diag(directions.T @ scatter @ directions) / variances
    assert 0.75 < ratios[:4].mean() < 1.4
    assert 0.75 < ratios[4:].mean() < 1.4


def test_a_ragged_side_is_noise_of_its_own_corners_only() -> None:
    image, camera, truth = one_marker(1, 7.0, 0.0)
    ragged = image.copy()
    for part in np.linspace(0.15, 0.85, 12):  # specks on the border of the first side
        x, y = np.rint(truth[0] + part * (truth[1] - truth[0])).astype(int)
        ragged[y - 2 : y + 2, x - 2 : x + 2] = 100
    even, uneven = (detect_markers(seen, camera)[0].noise for seen in (image, ragged))
    assert even is not None
    assert uneven is not None
    growth = np.diag(uneven).reshape(4, 2).sum(axis=1) / np.diag(even).reshape(4, 2).sum(axis=1)
    assert growth[:2].min() > 2.0
    assert growth[2:] == pytest.approx(np.ones(2), rel=0.1)


def test_nothing_to_see() -> None:
    assert detect_markers(np.full((1200, 1920), 128, np.uint8), lab_camera()) == []


def test_bad_input() -> None:
    with pytest.raises(InputError, match=r"dictionary = 'DICT_4X4': must be one of .*DICT_4X4_50"):
        detect_markers(np.zeros((1200, 1920), np.uint8), lab_camera(), "DICT_4X4")
    with pytest.raises(InputError, match="1000 x 500 px, but the camera's calibration is for 1920 x 1200"):
        detect_markers(np.zeros((500, 1000), np.uint8), lab_camera())
