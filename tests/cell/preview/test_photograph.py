"""A photograph on the page is what an ideal lens would have taken: points are where the pinhole puts them."""

from __future__ import annotations

import base64
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from arm.errors import InputError
from arm.io.storage import data_file
from cell.commands.preview import preview_file
from cell.console import Console
from cell.preview.content import page_content
from cell.preview.of_place import view_step
from cell.preview.photograph import WIDEST, photograph_url
from pages.preview import CAMERA
from plans.other_arms import scara_files
from vision.camera.model import Camera, Image
from wire.written_log import OPEN

BENT = replace(
    CAMERA,
    K=np.array([[900.0, 0, 510], [0, 905, 390], [0, 0, 1]]),
    distortion=np.array([-0.28, 0.1, 1e-3, -1e-3, 0.0]),
)


def _decoded(url: str) -> Image:
    kind, _, data = url.partition(",")
    assert kind == "data:image/jpeg;base64"
    image = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_GRAYSCALE)
    return np.asarray(image, dtype=np.uint8)


def _dots(camera: Camera, points: np.ndarray) -> Image:
    image = np.zeros((camera.size[1], camera.size[0]), np.uint8)
    for u, v in camera.project(points):
        cv2.circle(image, (round(16 * u), round(16 * v)), 16 * 6, 255, -1, cv2.LINE_AA, 4)
    return image


def test_points_are_where_the_pinhole_puts_them() -> None:
    points = np.array([(x, y, 1.0) for x in (-0.4, 0.0, 0.45) for y in (-0.25, 0.2)])
    flat = _decoded(photograph_url(BENT, _dots(BENT, points)))
    assert flat.shape[1] == WIDEST
    share = WIDEST / BENT.size[0]
    pinhole = (points @ BENT.K.T)[:, :2]
    assert np.abs(BENT.project(points) - pinhole).max() > 10.0
    count, _, _, centres = cv2.connectedComponentsWithStats((flat > 100).astype(np.uint8))
    assert count == 1 + len(points)
    found = (centres[1:] + 0.5) / share - 0.5
    for point in pinhole:
        assert np.linalg.norm(found - point, axis=1).min() < 1.5


def test_a_photograph_of_another_size_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"the photograph: is 640 x 480 px, but the camera's calibration is for 1920"
    ):
        photograph_url(CAMERA, np.zeros((480, 640), np.uint8))


def test_it_goes_with_the_camera(preview_case) -> None:
    case = preview_case
    arms = case.plan, case.robot_open, case.robot_holding, case.unit
    image = np.full((1200, 1920, 3), 130, np.uint8)
    content = page_content(*arms, camera=CAMERA, photograph=image)
    assert (np.abs(_decoded(content["camera"]["photograph"]).astype(int) - 130) < 3).all()
    assert page_content(*arms, camera=CAMERA)["camera"]["photograph"] is None
    assert page_content(*arms, photograph=image)["camera"] is None


def test_a_cell_is_shown_with_its_photograph(tmp_path: Path) -> None:
    (photograph, page) = tmp_path / "seen.png", tmp_path / "view.html"
    grey = np.full((1200, 1920), 90, np.uint8)
    grey[900:] = 160
    cv2.imwrite(str(photograph), grey)
    view_step(data_file("scenes/cell.toml"), None, None, page, Console(True), photograph)
    text = page.read_text().partition('<script id="content" type="application/json">')[2]
    content = json.loads(text.partition("</script>")[0])
    assert abs(int(_decoded(content["camera"]["photograph"])[300, 400]) - 90) < 3
    assert page.stat().st_size < 1.5e6


def test_a_photograph_of_another_size_is_named(tmp_path: Path) -> None:
    photograph = tmp_path / "half.png"
    cv2.imwrite(str(photograph), np.zeros((600, 960), np.uint8))
    with pytest.raises(
        InputError, match=r"half\.png: is 960 x 600 px, but the camera's calibration is for 1920"
    ):
        view_step(data_file("scenes/cell.toml"), None, None, tmp_path / "p.html", Console(True), photograph)


def test_what_has_no_camera_has_no_photograph(tmp_path: Path) -> None:
    photograph, page, log = (tmp_path / name for name in ("seen.png", "page.html", "wire.jsonl"))
    cv2.imwrite(str(photograph), np.zeros((4, 4), np.uint8))
    arm = scara_files(tmp_path)
    with pytest.raises(InputError, match=r"--image goes with a cell that has a camera"):
        view_step(arm, None, None, page, Console(True), photograph)
    log.write_text(json.dumps(OPEN) + "\n")
    with pytest.raises(InputError, match=r"--image goes with a plan; .* is a log"):
        preview_file(log, None, page, Console(True), None, photograph)
    assert not page.exists()
