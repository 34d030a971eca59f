"""The page of a chain's calibration."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.hand_eye.calibrate import HandEye
from cell.report.chain import chain_page
from cell.report.chain_text import (
    hand_eye_tables,
    print_hand_eye,
)
from pages.browsers import require_fit
from typed.heard import Heard


def test_nothing_is_told_of_images_left_out_where_none_is(found: HandEye) -> None:
    whole = replace(found.chain, fit=replace(found.chain.fit, weights=(np.ones(30),)))
    heard = Heard()
    print_hand_eye(replace(found, chain=whole), heard)
    assert "left out" not in heard.all
    assert "(images count from 0)" not in chain_page("", "", whole, [])


def test_tables_of_a_page_are_as_wide_as_it_is(found: HandEye) -> None:
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    halves = page.index('<div class="two">')
    assert page.index("<h2>Places</h2>") < page.index("<h2>Arm</h2>") < halves
    assert page.index("<h2>Residuals by image</h2>") > halves


@pytest.mark.slow
def test_the_page_fits(found: HandEye, tmp_path: Path) -> None:
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    require_fit(page, tmp_path, "hand-eye")


def test_ellipses_are_of_the_dots_that_are_drawn(found: HandEye) -> None:
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    section = page[page.index("<h2>Residuals of all corners</h2>") :]
    section = section[: section.index("</section>")]
    dots = np.array(re.findall(r'<circle cx="([^"]+)" cy="([^"]+)"', section), dtype=float)
    rings = np.array(re.findall(r'<ellipse rx="([^"]+)" ry="([^"]+)"', section), dtype=float)
    assert len(dots) > 300
    inside = [float((np.sum((dots / ring) ** 2, axis=1) < 1.0).mean()) for ring in rings]
    np.testing.assert_allclose(
        inside, [0.393, 0.865, 0.989], atol=0.06
    )  # of a normal distribution in the plane


def test_targets_are_drawn_where_the_calibration_puts_them(found: HandEye) -> None:
    """Each image's outline, in the camera's frame, projects onto the corners that were seen; those left out are red."""
    page = chain_page("Camera and arm", "r.json", found.chain, hand_eye_tables(found))
    section = page[page.index("<h2>Where the target was</h2>") :]
    section = section[: section.index("<h2>Residuals by image</h2>")]
    drawn = [
        (np.array([[float(v) for v in point.split(",")] for point in points.split()]), colour)
        for points, colour in re.findall(r'<polygon points="([^"]+)" stroke="var\(--(\w+)\)', section)
    ]
    (s,) = found.chain.problem.sightings
    count = len(s.readings)
    assert len(drawn) == 2 * count
    camera = replace(found.chain.problem.camera, distortion=np.zeros(5))
    for k in range(count):
        (above, colour), (aside, _) = drawn[k], drawn[count + k]
        assert above[:, 0] == pytest.approx(aside[:, 0])
        corners = 1e-3 * np.column_stack([above, aside[:, 1]])
        seen = s.pixels[k][np.isfinite(s.pixels[k][:, 0])]
        assert colour == ("blue" if found.chain.fit.weights[0][k] > 0.0 else "bad")
        if colour == "blue":
            hull = cv2.convexHull(camera.project(corners).astype(np.float32))
            outside = [-cv2.pointPolygonTest(hull, (float(u), float(v)), True) for u, v in seen]
            assert max(outside) < 25.0  # px; by the lens
            assert min(np.linalg.norm(camera.project(corners)[:, None] - seen, axis=2).min(axis=1)) < 25.0
