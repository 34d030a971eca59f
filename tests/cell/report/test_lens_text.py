"""A lens calibration: the terminal, the page and the JSON show the same numbers."""

from __future__ import annotations

from dataclasses import replace
from html import unescape

import numpy as np
import pytest

from calib.camera.calibrate import calibrate_camera
from calib.camera.result import CameraCalibration
from calib.model.intrinsics import NAMES, vector_of
from cell.report.camera import lens_page
from cell.report.lens_text import intrinsics_rows, left_out, lens_json, print_lens, rms_mm, view_row
from pictures.targets import CHARUCO, SIZE, photos, taken
from typed.heard import Heard

pytestmark = pytest.mark.xdist_group("lens_text")  # one process calibrates the lens


@pytest.fixture(scope="module")
def lens() -> CameraCalibration:
    """Accepted, with k3 held and one photo without a target."""
    shown = photos(taken(1))
    missing = replace(shown[0], name="empty.png", view=None, quality=None)
    return calibrate_camera([*shown, missing], CHARUCO, SIZE, held=("k3",))


def test_every_intrinsic_is_shown_with_its_standard_deviation(lens: CameraCalibration) -> None:
    rows = intrinsics_rows(lens)
    assert [name for name, _, _ in rows] == list(NAMES)
    values = vector_of(lens.camera)
    assert (rows[0][1], rows[4][1]) == (f"{values[0]:.2f} px", f"{values[4]:.5g}")
    assert [float(std) for _, _, std in rows[:-1]] == pytest.approx(lens.sigmas[:-1], rel=0.05)
    assert rows[-1] == ("k3", "0", "held")


def test_a_view_that_is_left_out_has_no_numbers_but_a_reason(lens: CameraCalibration) -> None:
    first, empty = lens.views[0], lens.views[-1]
    assert view_row(first)[:3] == (first.photo.name, str(len(first.photo.view.ids)), f"{first.rms_px:.3f}")  # type: ignore[union-attr]
    assert left_out(first) == ""
    assert view_row(empty) == ("empty.png", "0", "-", "-", "-", "-")
    assert left_out(empty) == f"left out: {empty.why_not}"


def test_terminal_page_and_json_show_the_same(lens: CameraCalibration) -> None:
    heard = Heard()
    print_lens(lens, heard)
    page, said = unescape(lens_page(lens, "shots")).replace("\N{MINUS SIGN}", "-"), lens_json(lens)
    for row in (*intrinsics_rows(lens), *map(view_row, lens.views)):
        assert all(f">{cell}<" in page for cell in row)
        assert any(all(cell in line for cell in row) for line in heard.told), row
    assert said["parameters"]["k3"] == {"value": 0.0, "std": None}
    assert said["parameters"]["fx"] == {"value": lens.camera.K[0, 0], "std": pytest.approx(lens.sigmas[0])}
    assert [view["used"] for view in said["views"]] == [True] * (len(lens.views) - 1) + [False]
    assert said["views"][-1]["why_not"] == lens.views[-1].why_not
    for shown in (page, heard.all):
        assert f"{said['work']['std_mm']:.3f} mm" in shown
        assert f"{said['work']['worst_std_mm']:.3f} mm" in shown
    assert (said["verdict"], heard.told[-1]) == ("accepted", "accepted")


def test_a_refusal_comes_with_its_reasons_and_with_views_that_would_help(lens: CameraCalibration) -> None:
    heard, refused = Heard(), replace(lens, reasons=("too few views",), remarks=("taken in one session",))
    print_lens(refused, heard)
    assert heard.told[-2:] == ["refused:", "  too few views"]
    assert "note: taken in one session" in heard.told
    assert ("views that would help most:" in heard.told) == bool(lens.next)
    assert {f"  {view.words}" for view in lens.next} <= set(heard.told)
    assert lens_json(refused)["reasons"] == ["too few views"]


def test_a_root_mean_square_is_in_millimetres() -> None:
    assert rms_mm(np.array([3e-3, 4e-3])) == pytest.approx(12.5**0.5)
