"""Budgets on the command line: what is refused, what is written where a search was stopped, and with which code."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ImpossibleError
from arm.plan_file import read_plan
from arm.se3 import rot_x, transform
from cell.commands.run import run_task
from cell.console import Console
from cell.session.budget import budget_of, within
from plan.budget import BudgetSpent, SearchBudget
from plan.program.assignment import search as sequence
from plans.interrupted import stop_when_complete
from tasks.small import quick_scenes, small_scenes
from typed.command_line import a465

POSE = {"T_base_tool": transform(rot_x(np.pi), (0.42, 0.1, 0.3)).tolist(), "free": "rz"}


@pytest.fixture(scope="module")
def looked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A task file and its look; no test may change them."""
    scenes = quick_scenes(tmp_path_factory.mktemp("looked"), 1, 3)
    a465("look", scenes / "task2.toml", "-o", scenes / "look.json")
    return scenes / "task2.toml", scenes / "look.json"


@pytest.mark.parametrize(
    ("option", "value", "rule"),
    [
        ("--budget", "0", "--budget = 0 s: must be from 0.001"),
        ("--give-up", "-1", "--give-up = -1 s: must be from"),
    ],
)
def test_budgets_that_are_none_are_refused(tmp_path: Path, option: str, value: str, rule: str) -> None:
    scenes = small_scenes(tmp_path)
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps([POSE]))
    _, told = a465("plan", scenes / "cell.toml", poses, "-o", tmp_path / "p.json", option, value, code=2)
    assert rule in told


def test_a_budget_that_is_spent_writes_nothing(tmp_path: Path, looked: tuple[Path, Path]) -> None:
    task, look = looked
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps([POSE]))
    for command in (("plan", task, "--look", look), ("plan", task.parent / "cell.toml", poses)):
        _, told = a465(*command, "-o", tmp_path / "p.json", "--budget", "0.001", code=3)
        assert "the budget of 0.001 s of effort is spent: n" in told
        assert not (tmp_path / "p.json").exists()
        _, told = a465(*command, "-o", tmp_path / "p.json", "--give-up", "0.001", code=3)
        assert "given up after 0.001 s of wall time" in told
        assert not (tmp_path / "p.json").exists()
    a465(*command, "-o", tmp_path / "free.json")
    a465(*command, "-o", tmp_path / "p.json", "--budget", "50", "--give-up", "500")
    assert (tmp_path / "p.json").read_bytes() == (tmp_path / "free.json").read_bytes()


@pytest.mark.slow
def test_ctrl_c_with_a_complete_plan_writes_it_and_ends_with_4(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, looked: tuple[Path, Path]
) -> None:
    task, look = looked
    stop_when_complete(monkeypatch, KeyboardInterrupt())
    _, told = a465("plan", task, "--look", look, "-o", tmp_path / "p.json", code=4)
    plan = read_plan(tmp_path / "p.json")
    assert "stopped: the search was interrupted: this is the best complete sequence found by then" in told
    assert f"it is written to {tmp_path / 'p.json'}, certified, code {plan.code}" in told
    assert plan.notes["search"].startswith("the search was interrupted")
    monkeypatch.undo()
    a465("check", tmp_path / "p.json", task)


def test_ctrl_c_before_that_writes_nothing_and_ends_with_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, looked: tuple[Path, Path]
) -> None:
    task, look = looked

    def pressed(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sequence.TaskSearch, "_checked", pressed)
    _, told = a465("plan", task, "--look", look, "-o", tmp_path / "p.json", code=3)
    assert "interrupted: no complete sequence was found" in told
    assert "nothing was written" in told
    assert not (tmp_path / "p.json").exists()


def test_a_spent_budget_anywhere_inside_is_a_refusal() -> None:
    with pytest.raises(ImpossibleError, match="budget of 2 s of effort is spent"), within(None):
        raise BudgetSpent("effort", 2.0, 2.0)
    assert budget_of(None, None) is None
    assert budget_of(2.0, None) == SearchBudget(2.0)


def test_a_run_whose_budget_is_spent_is_refused_before_anything_moves(tmp_path: Path) -> None:
    scenes = small_scenes(tmp_path)
    with pytest.raises(ImpossibleError, match=r"budget of 0\.001 s of effort is spent") as refused:
        run_task(
            scenes / "task2.toml", Console(as_json=True), folder=tmp_path / "run", budget=SearchBudget(0.001)
        )
    assert refused.value.exit_code == 3
