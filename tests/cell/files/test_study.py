"""What a study file may say, and how what it may not is told."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import pytest

from arm.errors import FileInputError
from cell.files.study import read_study
from studies.written import YAW, X, write_study
from typed.command_line import replace_in


def test_grids_and_samples_multiply(scenes: Path) -> None:
    grid = {"key": "noise_grey", "values": [1.0, 2.0, 3.0]}
    steps = {**YAW, "steps": 4}
    study = read_study(write_study(scenes, [X, grid, steps], points=10))
    assert study.count == 10 * 3 * 4
    assert study.vary[1].name == "noise_grey"
    assert study.vary[2].grid == (60.0, 80.0, 100.0, 120.0)
    assert study.world == scenes / "task2.world.toml"


@pytest.mark.parametrize(
    ("keys", "chunk"), [({}, 1000), ({"chunk": 7}, 7), ({"stages": ["reach", "plan"]}, 4)]
)
def test_chunks_are_large_where_only_reach_of_poses_is_asked(
    scenes: Path, keys: dict[str, Any], chunk: int
) -> None:
    assert read_study(write_study(scenes, points=8, **keys)).chunk == chunk


@pytest.mark.parametrize(
    ("vary", "keys", "words"),
    [
        ([X], {}, "points: is missing"),
        ([{**X, "steps": 3}], {"points": 5}, "points = 5: must be left out"),
        ([{**X, "to": 420.0}], {"points": 5}, "to = 420.0: must be more than from"),
        ([{"key": "seed"}], {"points": 5}, "from: is missing"),
        ([{**X, "values": [1, 2]}], {}, "must be left out where values are given"),
        ([X, X], {"points": 5}, "'x' is there twice"),
        ([{**X, "file": "wrld"}], {"points": 5}, "did you mean 'world'"),
        ([X], {"points": 5, "stages": ["plan", "reach"]}, "in this order"),
        ([X], {"points": 5, "world": "none.toml"}, "does not exist"),
        ([X], {"points": 5, "task": "none.toml"}, "does not exist"),
        ([{**X, "steps": 100_000}, {**YAW, "steps": 100_000}], {}, "must not make more than"),
        ([X], {"points": 2_000_000, "chunk": 1}, "chunk = 1: must make at most 1000000 chunks"),
        ([{**X, "name": "ok"}], {"points": 5}, "'ok' is in every table"),
        (
            [{"key": "seed", "values": [date(2026, 1, 1), 2]}],
            {},
            "a list of two or more different numbers or strings",
        ),
        ([{"key": "seed", "values": [1.0, float("inf")]}], {}, "a list of two or more different"),
    ],
)
def test_what_is_wrong_is_named(
    scenes: Path, vary: list[dict[str, Any]], keys: dict[str, Any], words: str
) -> None:
    with pytest.raises(FileInputError) as told:
        read_study(write_study(scenes, vary, **keys))
    assert words in str(told.value)
    assert "study.toml" in str(told.value)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("[[vary]]", "[vary]", "vary = {'key': .*: must be an array of tables"),
        ("[[vary]]", "[[varied]]", "vary: is missing"),
    ],
)
def test_a_study_without_its_tables_is_told_as_a_study(scenes: Path, old: str, new: str, told: str) -> None:
    file = write_study(scenes, [X], points=5)
    replace_in(file, old, new)
    with pytest.raises(FileInputError, match=told):
        read_study(file)


def test_a_file_of_another_kind_as_task_of_a_study_is_told_before_its_world(scenes: Path) -> None:
    study = write_study(scenes, [X])
    replace_in(study, 'task = "task2.toml"', 'task = "pen/drawing.toml"')
    with pytest.raises(
        FileInputError, match=r"drawing.toml: is a program file, and a task file belongs here"
    ):
        read_study(study)
