"""`a465 study` as a user has it."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cell.study.work.chunks import Chunk, Store
from cell.study.work.engine import Work, compute_all
from studies.cluster import cluster_here
from studies.written import YAW, X, write_study
from typed.command_line import a465, replace_in


@pytest.fixture
def asked(scenes: Path) -> Path:
    """A study of 40 placements in chunks of 8."""
    return write_study(scenes, [{**X, "from": 300.0, "to": 600.0}, YAW], points=40, chunk=8)


def test_it_computes_tells_and_goes_on(asked: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    said, _ = a465("study", asked, "-o", out, "--workers", "0", "--json")
    found = json.loads(said)
    rows = list(csv.DictReader((out / "table.csv").read_text().splitlines()))
    assert [int(row["point"]) for row in rows] == list(range(40))
    assert found["passed"] == sum(row["ok"] == "1" for row in rows)
    assert found["passed"] + sum(found["reasons"].values()) == 40
    assert 0 < found["passed"] < 40
    best = rows[found["best"]["point"]]
    assert best["ok"] == "1"
    assert float(best["x"]) == found["best"]["values"]["x"]
    before = (out / "table.csv").read_bytes()
    next(iter((out / "chunks").iterdir())).unlink()
    again, _ = a465("study", asked, "-o", out, "--workers", "0")
    assert "4 chunks were there already" in again
    assert (out / "table.csv").read_bytes() == before


@pytest.mark.slow
def test_the_best_place_is_written_as_files_that_reach_confirms(asked: Path, tmp_path: Path) -> None:
    out, best = tmp_path / "out", tmp_path / "best"
    said, _ = a465("study", asked, "-o", out, "--workers", "0", "--best", best)
    (task,) = best.rglob("task2.toml")
    look = best / "look.json"
    assert f"plan it: a465 look {task} -o {look} && a465 plan {task} --look {look}\n" in said
    a465("look", task, "-o", tmp_path / "look.json")
    a465("reach", task, "--look", tmp_path / "look.json")
    _, told = a465("study", asked, "-o", out, "--workers", "0", "--best", best, code=2)
    assert "is there already" in told


def test_no_best_place_is_told(scenes: Path, tmp_path: Path) -> None:
    file = write_study(scenes, [{**X, "from": 1000.0, "to": 1100.0}], points=4)
    options = ("-o", tmp_path / "out", "--workers", "0", "--best", tmp_path / "best")
    _, told = a465("study", file, *options, code=3)
    assert "no point passed" in told
    assert not (tmp_path / "best").exists()


def test_files_of_the_best_place_are_refused_before_anything_is_computed(asked: Path, tmp_path: Path) -> None:
    best = tmp_path / "best"
    best.mkdir()
    _, told = a465("study", asked, "-o", tmp_path / "out", "--workers", "0", "--best", best, code=2)
    assert "is there already; give a new folder" in told
    assert not (tmp_path / "out").exists()


def test_a_chunk_that_was_skipped_ends_with_4(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def without_one(chunks: list[Chunk], store: Store, *others: Any) -> Work:
        work = compute_all([one for one in chunks if one.number != 1], store, *others)
        return replace(work, aside=[chunks[1]], failed={1: "ZeroDivisionError: division"})

    monkeypatch.setattr("cell.study.command.compute_all", without_one)
    _, told = a465("study", asked, "-o", tmp_path / "out", "--workers", "0", code=4)
    assert (
        "1 chunk was skipped (ZeroDivisionError: division): points 8 to 15; the same command tries it" in told
    )
    rows = list(csv.DictReader((tmp_path / "out/table.csv").read_text().splitlines()))
    assert [int(row["point"]) for row in rows] == [*range(8), *range(16, 40)]


@pytest.mark.parametrize("looked", [False, True], ids=["exact", "looked"])
def test_the_files_of_a_point_have_the_look_that_its_study_asks_for(
    asked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, looked: bool
) -> None:
    looks, plans = list[Path](), list[tuple[Path, Path]]()
    monkeypatch.setattr("cell.study.command.look_step", lambda task, *_: looks.append(task))

    def plan(task: Path, look: Path, *_: object) -> dict[str, object]:
        plans.append((task, look))
        return {}

    monkeypatch.setattr("cell.study.command.plan_step", plan)
    if looked:
        asked.write_text('stages = ["reach", "look"]\n' + asked.read_text())
    a465("study", asked, "--point", "7", "-o", tmp_path / "point")
    ((task, look),) = plans
    assert task.is_file()
    assert looks == ([task] if looked else [])
    if not looked:
        assert len(json.loads(look.read_text())["scenes"]) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scheduler", "tcp://127.0.0.1:1", "--workers", "2"), "must be left out with --scheduler"),
        (("--point", "40"), "must be 0 to 39"),
        (("--point", "4", "--workers", "2"), "--point: needs no --workers"),
    ],
)
def test_wrong_options_are_told(asked: Path, tmp_path: Path, options: tuple[str, ...], words: str) -> None:
    _, told = a465("study", asked, "-o", tmp_path / "out", *options, code=2)
    assert words in told


@pytest.mark.slow
def test_workers_with_several_threads_are_refused(asked: Path, tmp_path: Path) -> None:
    with cluster_here(workers=1, threads=2) as cluster:
        options = ("-o", tmp_path / "out", "--scheduler", cluster.scheduler_address)
        _, told = a465("study", asked, *options, code=2)
    assert "has a worker with several threads" in told
    assert "--nthreads 1" in told


def test_a_key_that_is_not_in_the_file_is_told_before_anything_is_computed(
    asked: Path, tmp_path: Path
) -> None:
    replace_in(asked, "boards[1].centre_mm[0]", "boards[2].centre_mm[0]")
    _, told = a465("study", asked, "-o", tmp_path / "out", code=2)
    assert "boards[2].centre_mm[0]: is not in the file" in told
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("made", "words"),
    [
        ("out", "out: is a file; give a folder for the results"),
        ("out/table.csv", "table.csv: is there already, and no study wrote it; give another folder"),
        ("out/study.html", "study.html: is there already, and no study wrote it; give another folder"),
    ],
)
def test_what_no_study_wrote_is_not_replaced(asked: Path, tmp_path: Path, made: str, words: str) -> None:
    file = tmp_path / made
    file.parent.mkdir(exist_ok=True)
    file.write_text("my own")
    _, told = a465("study", asked, "-o", tmp_path / "out", "--workers", "0", code=2)
    assert words in told
    assert file.read_text() == "my own"
    assert not (tmp_path / "out" / "chunks").exists()
