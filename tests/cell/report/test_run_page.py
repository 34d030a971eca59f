"""The report of a run: one file that says what became of every cube, with what was seen."""

from __future__ import annotations

import base64
import re
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from arm.io.storage import data_file
from cell.accuracy.placement import PlacementBudget, Source
from cell.files.task import Task, read_task
from cell.report.run_page import KeptPlan, Picture, run_page
from pages.browsers import require_fit

BEGAN = datetime(2026, 11, 22, 9, 5)
ENDED = datetime(2026, 11, 22, 9, 7)


@pytest.fixture(scope="module")
def task() -> Task:
    return read_task(data_file("scenes/task2.toml"))


def cube(number: int, **other: Any) -> dict[str, Any]:
    row = {
        "from": f"01-02/{number}",
        "to": f"03-04/{number}",
        "placed": True,
        "error_mm": 0.004 * number,
        "tilt_error_deg": 0.01 * number,
        "motion_s": 20.0 + number,
        "min_clearance_mm": 9.0 - number,
        "remarks": [],
    }
    return row | other


def report(*cubes: dict[str, Any], **other: Any) -> dict[str, Any]:
    said = {
        "cubes": list(cubes),
        "cubes_planned": len(cubes),
        "wires": [],
        "unit": "crs93",
        "motion_s": 41.25,
        "speed": 0.5,
        "override": 1.0,
        "time_scale": 10.0,
        "simulated": True,
        "remarks": [],
    }
    return said | other


def words(html: str) -> str:
    """What a person reads."""
    body = re.sub(r"<style>.*?</style>", "", html, flags=re.DOTALL)
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body))


def test_a_run_that_is_done_says_so_with_its_figures(task: Task) -> None:
    text = words(run_page(task, report(cube(1), cube(2)), [], [], BEGAN, ENDED))
    assert "task2 done" in text
    assert "2 of 2 cubes placed" in text
    assert "41.2 s of planned motion" in text
    assert "7.0 mm least clearance" in text
    assert "0.008 mm largest error (truth)" in text
    assert "0.020 deg largest tilt (truth)" in text
    assert f"{BEGAN:%Y-%m-%d %H:%M:%S} to {ENDED:%H:%M:%S}" in text
    assert "2 01-02/2 03-04/2 yes 22.0 7.0 0.008 0.020" in text
    assert "hand-eye calibration none" in text
    assert "of planned motion" not in words(run_page(task, report(motion_s=0.0), [], [], BEGAN, ENDED))


def test_a_cube_that_was_left_and_an_error_are_not_done(task: Task) -> None:
    missed = cube(
        2, placed=False, error_mm=None, tilt_error_deg=None, remarks=["the jaws closed on <nothing>"]
    )
    html = run_page(task, report(cube(1), missed, simulated=False, override=0.3), [], [], BEGAN, ENDED)
    text = words(html)
    assert "task2 not done" in text
    assert "1 of 2 cubes placed" in text
    assert "real cell · speed 0.5, override 0.3" in text
    assert "2 01-02/2 03-04/2 NO 22.0 7.0 - - the jaws closed on &lt;nothing&gt;" in text
    error = {"kind": "ExecutionStopped", "word": "stopped", "message": "interrupted & stopped"}
    text = words(run_page(task, report(cube(1), error=error, cubes_planned=4), [], [], BEGAN, ENDED))
    assert "task2 stopped" in text
    assert "1 of 4 cubes placed" in text
    assert "interrupted &amp; stopped" in text
    text = words(run_page(task, report(), [], [], BEGAN, ENDED))
    assert "No cube was moved." in text
    assert "cubes placed" not in text, "a list of poses places none"
    assert "41.2 s of planned motion" in text


def test_pictures_are_in_the_page_and_no_larger_than_they_need(task: Task, tmp_path: Path) -> None:
    image = np.zeros((600, 1920, 3), dtype=np.uint8)
    image[:, 960:] = (0, 0, 255)
    cv2.imwrite(str(tmp_path / "look-1.png"), image)
    (tmp_path / "look-2.png").write_bytes(b"not a picture")
    pictures = [Picture("from q_start", tmp_path / "look-1.png"), Picture("after", tmp_path / "look-2.png")]
    html = run_page(task, report(cube(1)), pictures, [], BEGAN, ENDED)
    (data,) = re.findall(r"data:image/jpeg;base64,([^\"]+)", html)
    shown = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (300, 960, 3)
    assert shown[150, 100].max() < 20
    assert np.abs(shown[150, 900].astype(int) - [0, 0, 255]).max() < 20
    assert "Look 1: from q_start" in html
    assert "look-2.png cannot be read" in html
    assert "The look was not finished" in words(
        run_page(task, report(), [Picture("stopped", tmp_path / "look-3.png")], [], BEGAN, ENDED)
    )
    assert not re.search(r"https?:|//[a-z]|src=\"(?!data:)", html)


def test_predicted_errors_are_a_table_and_a_picture_over_their_board(task: Task) -> None:
    covariance = np.diag([1e-6, 4e-6, 9e-6, 0.0, 0.0, 0.0])
    sources = {"repeatability": Source(2e-3, 0.8), "detection": Source(1e-3, 0.2)}
    budgets = [
        PlacementBudget(f"cube 01-02/{n}", f"01-02/{n}", f"03-04/{n}", covariance, sources, 0.91234)
        for n in (1, 3)
    ]
    html = run_page(task, report(cube(1)), [], [], BEGAN, ENDED, budgets)
    assert "cube 01-02/3 03-04/3 2.24 3.00 0.00 91.23 repeatability 80 %, detection 20 %" in words(html)
    assert html.count("<ellipse") == 2
    assert html.count('class="board"') == 1
    assert (
        'rx="48.95" ry="24.48" transform="rotate(90.0)"' in html
    )  # 2.45 times 2 mm along y and 1 mm along x, by 10
    assert "91.23 %" in html
    assert "Predicted accuracy" not in run_page(task, report(cube(1)), [], [], BEGAN, ENDED)


@pytest.mark.slow
def test_the_page_fits(task: Task, tmp_path: Path) -> None:
    sources = {"repeatability": Source(2e-3, 0.8), "detection": Source(1e-3, 0.2)}
    budget = PlacementBudget("cube 01-02/1", "01-02/1", "03-04/1", 1e-6 * np.eye(6), sources, 0.91234)
    rows = (cube(1), cube(2, remarks=["taken again from 01-02/2 after it was missed at the first try"]))
    require_fit(run_page(task, report(*rows), [], [], BEGAN, ENDED, [budget]), tmp_path, "run")


def test_plans_are_named_with_their_pages_and_what_they_rest_on(task: Task, preview_case) -> None:
    plans = [KeptPlan("to-start", preview_case.plan), KeptPlan("plan-2", preview_case.plan)]
    html = run_page(task, report(cube(1)), [], plans, BEGAN, ENDED)
    assert 'href="preview-2.html"' in html
    assert html.count("href=") == 1
    assert f"plan-2.json 4 {preview_case.plan.duration_s:.1f}" in words(html)
    assert preview_case.plan.sha256[:12] in html
    assert preview_case.plan.code not in html, "who reads the report has not seen the preview"
