"""The page of a camera's calibration."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from calib.camera.calibrate import calibrate_camera
from cell.report.camera import lens_page
from pages.browsers import require_fit
from pictures.targets import CHARUCO, SIZE, photos, taken


@pytest.mark.slow
def test_the_page_fits(tmp_path: Path) -> None:
    require_fit(lens_page(calibrate_camera(photos(taken(1)), CHARUCO, SIZE), "one"), tmp_path, "lens")


def test_views_to_take_at_one_place_have_labels_beside_each_other():
    """1 and 2 over each other read 12."""
    c = calibrate_camera(photos(taken(1)), CHARUCO, SIZE)
    same = replace(c, next=(c.next[0], c.next[0], c.next[0]))
    found = re.findall(
        r'<text x="(\d+)" y="(\d+)" style="font-size:(\d+)px[^>]*>(\d)</text>', lens_page(same, "one")
    )
    assert [number for *_, number in found] == ["1", "2", "3"]
    places = [(int(x), int(y)) for x, y, *_ in found]
    size = int(found[0][2])
    for a in range(3):
        for b in range(a):
            assert max(abs(p - q) for p, q in zip(places[a], places[b], strict=True)) >= size - 1
