"""The page has all it draws in itself, and draws it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from cell.files.study import Study, read_study
from cell.study.answer.answers import best_of, influences, read_points
from cell.study.answer.page import study_page
from cell.study.question.points import points_of
from cell.study.question.scratch import bundle_of
from cell.study.work.chunks import Chunk
from cell.study.work.stages import Evaluator
from pages.browsers import chromium, complaints_of, keep_screenshot
from studies.written import YAW, X, write_study


def _page(study: Study) -> str:
    points = read_points(
        study, [(Chunk(0, 0, study.count, ""), Evaluator(bundle_of(study)).table(0, study.count))]
    )

    def values_of(number: int) -> tuple[object, ...]:
        return points_of(study, number, 1)[0]

    best = best_of(study, points, values_of)
    return study_page(study, points, best, influences(study, points), values_of, "study.toml")


def test_every_point_is_in_every_map(scenes: Path) -> None:
    grid = {"key": "boards[0].tilt_deg", "name": "</script>tilt", "values": [0.0, 7.0, 30.0]}
    study = read_study(write_study(scenes, [{**X, "from": 300.0, "to": 600.0}, grid, YAW], points=16))
    page = _page(study)
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data = json.loads(found[1])
    assert data["axes"][1]["name"] == "</script>tilt"
    assert len(data["points"]) == study.count
    assert [(m["x"], m["y"]) for m in data["maps"]] == [(0, 1), (0, 2), (1, 2)]
    passed = sum(point[3] < 0 for point in data["points"])
    for made in data["maps"]:
        assert sum(made["n"]) == study.count
        assert sum(made["ok"]) == passed
    assert 0 < passed < study.count
    assert not re.search(r"(src|href)=", page)


def test_a_single_value_makes_a_page_too(scenes: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "steps": 3}]))
    assert '"maps":[{"x":0,"y":0' in _page(study)


@pytest.mark.slow
def test_it_is_drawn_without_errors(scenes: Path, tmp_path: Path) -> None:
    study = read_study(write_study(scenes, [{**X, "from": 300.0, "to": 600.0}, YAW], points=32))
    file = tmp_path / "study.html"
    file.write_text(_page(study))
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        complaints = complaints_of(page)
        page.goto(file.as_uri())
        page.locator("#map").click(position={"x": 300, "y": 200})
        page.select_option("#what", "ok")
        assert "all" in page.locator("#legend").inner_text()
        keep_screenshot(page, tmp_path, "study")
        page.set_viewport_size({"width": 390, "height": 844})
        page.wait_for_function("size.width === canvas.clientWidth && canvas.clientWidth < 390")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert complaints == []
