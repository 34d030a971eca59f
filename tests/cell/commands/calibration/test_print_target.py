"""A target to print: what a camera would see of the drawing is the target, corner by corner."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from arm.io.storage import data_file
from cell.commands.calibration.print_target import target_svg
from typed.command_line import a465, replace_in
from vision.targets.target import Target, TargetFinder

PX_PER_MM = 12
SVG = "{http://www.w3.org/2000/svg}"


def drawn(svg: str) -> tuple[np.ndarray, np.ndarray]:
    """The drawing as an image, and where its origin is in it, px: each rectangle by the pixels it covers."""
    root = ET.fromstring(svg)
    left, top, width, height = map(float, root.get("viewBox").split())
    assert root.get("width") == f"{width:g}mm"
    assert root.get("height") == f"{height:g}mm"
    image = np.full((round(height * PX_PER_MM), round(width * PX_PER_MM), 3), 255, np.uint8)
    for rect in root.find(f"{SVG}g").iter(f"{SVG}rect"):
        x, y, w, h = (float(rect.get(key)) for key in ("x", "y", "width", "height"))
        box = np.rint(PX_PER_MM * np.array([x - left, y - top, x - left + w, y - top + h])).astype(int)
        image[box[1] : box[3], box[0] : box[2]] = 0
    return image, -PX_PER_MM * np.array([left, top])


@pytest.mark.parametrize(
    "target",
    [
        Target(),
        Target(square=0.012, marker=0.009),
        Target("charuco", 5, 7, 0.020, 0.014, "DICT_4X4_50"),
        Target("checkerboard", 8, 5, 0.015, 0.0, ""),
        Target("charuco", 5, 6, 0.020, 0.014, "DICT_4X4_50", legacy=True),
    ],
)
def test_the_drawing_is_found_as_the_target(target: Target) -> None:
    image, origin = drawn(target_svg(target))
    view = TargetFinder(target).find(image)
    assert view is not None
    assert len(view.ids) == target.corners
    expected = origin + 1e3 * PX_PER_MM * target.points()[view.ids, :2] - 0.5
    assert np.abs(view.corners_px - expected).max() < 0.1


def test_the_command_draws_what_the_hand_is_to_hold(tmp_path: Path) -> None:
    said, _ = a465("calibrate", "target", data_file("scenes/targets/hand.toml"), "-o", tmp_path / "hand.svg")
    assert "7 x 5 squares of 12 mm" in said
    assert "print it at 100 %" in said
    image, _ = drawn((tmp_path / "hand.svg").read_text())
    assert TargetFinder(Target(square=0.012, marker=0.009)).find(image) is not None
    _, told = a465("calibrate", "target", "-o", tmp_path / "target.png", code=2)
    assert "must end in .svg" in told


@pytest.mark.parametrize(
    ("square", "marker", "told"),
    [(3, 2.2, "is the target in cm?"), (30, 29.5, "from 0.4 to 0.9"), (30, 22, "")],
)
def test_a_print_that_is_hardly_meant_is_told(
    tmp_path: Path, square: float, marker: float, told: str
) -> None:
    target = tmp_path / "target.toml"
    target.write_text(
        f'kind = "charuco"\nsquares = [7, 5]\nsquare_mm = {square}\nmarker_mm = {marker}\ndictionary = "DICT_5X5_100"\n'
    )
    said, _ = a465("calibrate", "target", target, "-o", tmp_path / "target.svg")
    assert ("NOTE" in said) == bool(told)
    assert told in said
    replace_in(target, '"charuco"', '"checkerboard"')
    _, why = a465("calibrate", "target", target, "-o", tmp_path / "other.svg", code=2)
    assert "marker_mm = " in why
    assert 'is of a target with markers, and kind is "checkerboard"' in why
