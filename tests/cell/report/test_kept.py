"""Runs are listed with what each is; old ones are removed once somebody agreed, and nothing else is."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

import cell.commands.report
from arm.errors import InputError
from arm.io.storage import data_file
from cell.commands.report import runs_step
from cell.console import Console
from cell.report.kept import DAY, kept_runs, older
from typed.command_line import a465, refused


def _run(folder: Path, name: str, days: float, report: str | None = None) -> Path:
    """A run that was written so many days ago."""
    place = folder / "runs" / name
    (place / "shots").mkdir(parents=True)
    (place / "wire.jsonl").write_text("{}\n")
    (place / "shots" / "1.png").write_bytes(bytes(1000))
    if report is not None:
        (place / "report.json").write_text(report)
    at = time.time() - days * DAY
    for file in (*place.rglob("*"), place):
        os.utime(file, (at, at))
    return place


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    _run(tmp_path, "task2-1", 40.0, '{"task": "task2"}')
    _run(tmp_path, "home-12", 35.0)
    _run(tmp_path, "task2-2", 3.0, '{"task": "task2", "error": {"word": "stopped"}}')
    _run(tmp_path, "jog-1", 2.0, "not JSON")
    (tmp_path / "runs" / "notes").mkdir()
    (tmp_path / "runs" / "notes" / "mine.txt").write_text("mine")
    os.utime(tmp_path / "runs" / "notes" / "mine.txt", (0.0, 0.0))
    return tmp_path


def _left(folder: Path) -> set[str]:
    return {one.name for one in (folder / "runs").iterdir()}


def test_runs_are_listed_the_oldest_first(folder: Path) -> None:
    said, _ = a465("runs", "--json", cwd=folder)
    found = json.loads(said)["runs"]
    assert [(Path(run["folder"]).name, run["of"], run["ended"]) for run in found] == [
        ("task2-1", "task2", "done"),
        ("home-12", "home", ""),
        ("task2-2", "task2", "stopped"),
        ("jog-1", "jog", ""),
    ]
    assert found[1]["bytes"] == 1003
    said, _ = a465("runs", folder / "runs")
    assert "4 runs" in said
    assert "no report" in said


def test_only_runs_that_are_old_enough_are_removed(folder: Path) -> None:
    """Another folder stays, and so does what a link points to."""
    elsewhere = _run(folder / "elsewhere", "task2-1", 99.0)
    (folder / "runs" / "link").symlink_to(elsewhere)
    a465("runs", "--prune", 30, "--yes", cwd=folder)
    assert _left(folder) == {"task2-2", "jog-1", "notes", "link"}
    assert (elsewhere / "wire.jsonl").exists()
    said, _ = a465("runs", "--prune", 30, "--yes", cwd=folder)
    assert "nothing is removed" in said


@pytest.mark.parametrize("more", [[], ["--prune", 30, "--yes"]])
def test_a_run_is_no_folder_of_runs(folder: Path, more: list[object]) -> None:
    run = folder / "runs" / "task2-1"
    (run / "looks").mkdir()
    (run / "looks" / "report.json").write_text("{}")
    before = sorted(folder.rglob("*"))
    _, told = a465("runs", "runs/task2-1", *more, code=2, cwd=folder)
    assert (
        told == "a465: wrong input: runs/task2-1: is a run itself; give the folder that contains runs: runs\n"
    )
    _, told = a465("runs", ".", *more, code=2, cwd=run)
    assert told.endswith(f".: is a run itself; give the folder that contains runs: {run.parent}\n")
    assert sorted(folder.rglob("*")) == before


def test_one_new_file_keeps_a_run(folder: Path) -> None:
    (folder / "runs" / "task2-1" / "shots" / "2.png").write_bytes(b"")
    a465("runs", "--prune", 30, "--yes", cwd=folder)
    assert "task2-1" in _left(folder)


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("--prune", "30"), "no terminal to confirm that runs may be removed: give --yes"),
        (("--prune", "0"), "--prune 0: must be at least 1 day"),
        (("--prune", "0.5", "--yes"), "--prune 0.5: must be at least 1 day"),
        (("--prune", "nan", "--yes"), "must be at least 1 day"),
        (("--yes",), "--yes needs --prune DAYS"),
        (("nowhere",), "nowhere: No such file or directory"),
    ],
)
def test_without_an_answer_or_with_a_wrong_one_all_stay(
    folder: Path, words: tuple[str, ...], why: str
) -> None:
    before = _left(folder)
    assert why in refused("runs", *words, code=2, cwd=folder)
    assert _left(folder) == before


def test_what_is_old_is_told_by_its_newest_file(folder: Path) -> None:
    runs = kept_runs(folder / "runs")
    assert [run.folder.name for run in older(runs, 36.0, time.time())] == ["task2-1"]
    assert older(runs, 41.0, time.time()) == []
    with pytest.raises(InputError, match="at least 1 day"):
        older(runs, 0.0, time.time())


@pytest.mark.parametrize(("word", "removed"), [("PRUNE", True), ("yes", False), (None, False)])
def test_a_person_is_asked(
    folder: Path, monkeypatch: pytest.MonkeyPatch, word: str | None, removed: bool
) -> None:
    before = _left(folder)
    monkeypatch.setattr(cell.commands.report, "at_terminal", lambda: True)
    monkeypatch.setattr(cell.commands.report, "typed", lambda: word)
    if removed:
        runs_step(folder / "runs", 30.0, False, Console())
    else:
        with pytest.raises(InputError, match="'prune' was not typed; nothing was removed"):
            runs_step(folder / "runs", 30.0, False, Console())
    assert _left(folder) == (before - {"task2-1", "home-12"} if removed else before)


def test_a_file_in_place_of_a_folder_of_runs_is_told_as_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("of Monday\n")
    for command in ("runs", "report"):
        for file, words in (
            (data_file("scenes/cell.toml"), "is a cell file; give"),
            (tmp_path / "notes", "is a file; give"),
        ):
            _, told = a465(command, file, code=2)
            assert words in told


def test_a_folder_of_other_things_is_told(tmp_path: Path) -> None:
    assert "NOTE" not in a465("runs", tmp_path)[0]
    (tmp_path / "cell.toml").touch()
    assert f"NOTE: no folder in {tmp_path} has the log or the report of a run" in a465("runs", tmp_path)[0]
