"""A day of runs in one table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from arm.errors import InputError
from cell.report.runs import HEADER, read_runs, runs_page, runs_to_json
from pages.browsers import require_fit
from typed.command_line import a465


def _cube(placed: bool, *faults: str, error: float | None = None) -> dict[str, Any]:
    return {"placed": placed, "faults": list(faults), "error_mm": error}


def _write(folder: Path, name: str, cubes: list[dict[str, Any]], **more: Any) -> Path:
    place = folder / name
    place.mkdir(parents=True)
    report = {"task": "task2", "cubes": cubes, "cubes_planned": 2, "motion_s": 40.0, **more}
    (place / "report.json").write_text(json.dumps(report))
    return place


@pytest.fixture
def day(tmp_path: Path) -> Path:
    runs = tmp_path / "runs"
    at, stopped = "2026-11-26T{}:00:00+01:00", {"word": "stopped", "message": "an axis stands still"}
    good = [_cube(True, error=0.2), _cube(True, "not gripped", error=0.4)]
    _write(runs, "a", good, began=at.format(10), lasted_s=50.0)
    bad = [_cube(False, "not confirmed", "not located")]
    _write(runs, "b", bad, began=at.format("09"), lasted_s=9.0, error=stopped)
    _write(runs, "old", [{"placed": True}])  # of an older version
    return runs


def test_runs_are_told_in_the_order_of_their_beginnings_with_what_they_have_in_common(day: Path) -> None:
    runs = read_runs([day, day / "a"])  # none twice
    assert [run.folder.name for run in runs] == ["old", "b", "a"]
    assert [run.cubes for run in runs] == [2, 2, 2]
    found = runs_to_json(runs)
    assert (found["done"], found["cubes"], found["placed"], found["recovered"]) == (2, 6, 3, 1)
    assert found["faults"] == {"not gripped": 1, "not confirmed": 1, "not located": 1}
    assert found["causes"] == {"an axis stands still": 1}
    assert found["error_mm"] == {"median": pytest.approx(0.3), "most": 0.4}
    assert found["lasted_s"] == {"median": 50.0, "most": 50.0}  # of runs that were done, where it is known
    json.dumps(found, allow_nan=False)
    rows = [dict(zip(HEADER, run.row(), strict=True)) for run in runs]
    assert rows[2]["began"] == "2026-11-26 10:00:00"
    assert [row["taken again"] for row in rows] == ["0", "1", "1"]
    assert rows[0]["lasted s"] == "-"
    assert [row["planned s"] for row in rows] == ["40.0"] * 3  # at the plan's speed, not as executed
    _write(day, "jaws", [], motion_s=0.0)  # of `gripper open`
    assert dict(zip(HEADER, read_runs([day / "jaws"])[0].row(), strict=True))["planned s"] == "-"


def test_the_command_prints_the_table_and_writes_the_page(day: Path, tmp_path: Path) -> None:
    page = tmp_path / "day.html"
    said, _ = a465("report", str(day), "-o", str(page))
    assert "2 of 3 runs done, 3 of 6 cubes placed, 1 of them after a fault" in said
    assert "1 run ended: an axis stands still" in said
    assert "an axis stands still" in page.read_text()
    as_json, _ = a465("report", str(day), "--json")
    assert json.loads(as_json)["placed"] == 3


@pytest.mark.slow
@pytest.mark.parametrize("name", ["report.html", "preview.html", "preview-cube-2.html"])
def test_a_page_of_a_run_is_not_replaced(day: Path, name: str) -> None:
    page = day / "a" / name
    a465("report", day, "-o", page)  # none is there
    page.write_text("of the run")
    _, told = a465("report", day, "-o", page, code=2)
    rule = f"belongs to the run {page.parent}, and another page would replace it; give another name"
    assert told == f"a465: wrong input: {page}: {rule}\n"
    assert page.read_text() == "of the run"
    for other in (day / "a/day.html", day / name):
        for _ in range(2):
            a465("report", day, "-o", other)


def test_the_page_fits(day: Path, tmp_path: Path) -> None:
    require_fit(runs_page(read_runs([day])), tmp_path, "runs")


def test_a_page_without_faults_says_so(tmp_path: Path) -> None:
    page = runs_page(read_runs([_write(tmp_path, "one", [_cube(True)])]))
    assert "Every run was done." in page


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "has no report.json"),
        ("{", "is no JSON"),
        ("[]", "must be"),
        ('{"task": "x", "cubes": 3}', "cubes"),
    ],
)
def test_what_is_no_report_is_refused_by_name(tmp_path: Path, text: str | None, why: str) -> None:
    if text is not None:
        (tmp_path / "report.json").write_text(text)
    with pytest.raises(InputError, match=why) as refused:
        read_runs([tmp_path])
    assert str(tmp_path) in str(refused.value)


def test_a_page_without_its_option_is_told(tmp_path: Path) -> None:
    told = a465("report", "day.html", code=2, cwd=tmp_path)[1]
    assert told.endswith(
        "day.html: no such folder of runs; is it the page to write? give it with -o day.html\n"
    )
    assert "-o" not in a465("report", "rnus", code=2, cwd=tmp_path)[1]
