"""A cell, program or arm without a plan as a page: bodies where they stand, the arm where it is asked to be."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.preview.of_place import LEAST_CONTRAST, photograph_for, view_step
from cell.preview.page import Drawn

CELL = data_file("scenes/cell.toml")


def _viewed(folder: Path, file: Path, angles: str | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
    page = folder / "page.html"
    result = view_step(file, None, angles, page, Console(True))
    text = page.read_text().partition('<script id="content" type="application/json">')[2]
    return result, json.loads(text.partition("</script>")[0])


def test_a_cell_at_q_start_has_its_bodies_its_camera_and_no_code_to_approve(tmp_path: Path) -> None:
    result, content = _viewed(tmp_path, CELL)
    assert {"table", "camera post"} <= {body["name"] for body in content["bodies"]}
    assert content["camera"] is not None
    assert content["code"] is None
    assert content["resting"]
    start = np.array(content["steps"][0]["counts"]) - content["joints"]["counts_at_zero"]
    degrees = np.degrees(start / content["joints"]["counts_per_rad"])
    np.testing.assert_allclose(degrees, [-60, -40, -80, 0, -60, 0], atol=2e-3)
    assert result["distance_mm"] > 10.0


def test_where_the_arm_would_collide_both_bodies_are_named(tmp_path: Path) -> None:
    result, content = _viewed(tmp_path, CELL, "-114,79,81,112,-4,-93")
    assert result["distance_mm"] <= 0.0
    assert content["refused"]["pair"] == result["closest"]
    assert "is inside" in content["refused"]["what"]


def test_programs_and_their_work(tmp_path: Path) -> None:
    _, content = _viewed(tmp_path, data_file("scenes/hoop/d.toml"))
    assert "bar 1" in {body["name"] for body in content["bodies"]}
    with pytest.raises(ImpossibleError, match="board 01-02, on which the workpiece is, was not found"):
        _viewed(tmp_path, data_file("scenes/hoop/seen.toml"))


@pytest.mark.parametrize("angles", ["0,0,0", "a", "0,0,0,0,0,nan", "0,200,0,0,0,0"])
def test_wrong_angles_are_refused(tmp_path: Path, angles: str) -> None:
    with pytest.raises(
        InputError, match=r"q ?=.*(must be 6 numbers .*, J1, .* in deg|J2 must be from -88.7 to 89.0 deg)"
    ):
        _viewed(tmp_path, CELL, angles)
    assert not (tmp_path / "page.html").exists()


@pytest.mark.parametrize("dark", [0, 100, 255 - LEAST_CONTRAST])
def test_a_photograph_that_shows_nothing_is_refused(tmp_path: Path, dark: int) -> None:
    camera = read_cell(CELL).camera
    image, file = np.full(camera.size[::-1], dark, np.uint8), tmp_path / "a.png"
    for more in (0, LEAST_CONTRAST - 1):
        image[3, 5] = dark + more
        cv2.imwrite(str(file), image)
        with pytest.raises(InputError, match=f"a.png: shows nothing: .* from {dark} to {dark + more} of"):
            photograph_for(Drawn(camera=camera), file, CELL)
    image[3, 5] = dark + LEAST_CONTRAST
    cv2.imwrite(str(file), image)
    assert np.array_equal(photograph_for(Drawn(camera=camera), file, CELL), image)
