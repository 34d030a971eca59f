"""The task of a plan is found by name and content, near the plan, and nothing else is taken for it."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from arm.errors import InputError
from arm.plan_file import Plan, read_plan, write_plan
from cell.program.find_task import DEEPEST, task_of_plan_file, task_or_none
from plan.trajectory.virtual_unit import NO_UNIT
from programs.program_files import program
from typed.command_line import a465, replace_in


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a program in a cell, and its plan."""
    file = program(tmp_path_factory.mktemp("planned"))
    folder, text = file.parent, file.read_text()
    (folder / "short.toml").write_text(text[: text.index("[[steps]]")] + JOINTS)
    a465("plan", folder / "short.toml", "-o", folder / "plan.json")
    return folder


JOINTS = """[[steps]]
name = "there"
joints_deg = [10, 0, -45, 0, -45, 0]
"""


@pytest.fixture
def here(planned: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "here"
    shutil.copytree(planned, folder)
    monkeypatch.chdir(folder)
    return folder


def test_it_is_found_beside_the_plan_above_it_and_below_the_present_folder(here: Path) -> None:
    assert task_of_plan_file(Path("plan.json")) == Path("short.toml")
    runs = here / "runs" / "short-1"
    runs.mkdir(parents=True)
    shutil.copy(here / "plan.json", runs)
    assert task_of_plan_file(runs / "plan.json") == Path("short.toml")
    deep = here.joinpath(*"abc"[:DEEPEST])
    shutil.copytree(here, deep, ignore=shutil.ignore_patterns("a", "runs", "plan.json"))
    (here / "short.toml").unlink()
    assert task_of_plan_file(Path("plan.json")) == Path("a/b/c/short.toml")
    said, told = a465("check", "plan.json", cwd=here)
    assert "task: a/b/c/short.toml" in said + told
    shutil.copytree(deep, deep / "d")
    (deep / "short.toml").unlink()
    with pytest.raises(
        InputError, match=r"there is no short.toml here that it was made for; give its task file"
    ):
        task_of_plan_file(Path("plan.json"))


def test_of_two_cells_with_the_same_task_that_of_the_plan_is_found(here: Path) -> None:
    own = here / "own"
    shutil.copytree(here, own, ignore=shutil.ignore_patterns("own", "plan.json"))
    replace_in(here / "cell.toml", '"crs93"', '"crs97"')
    a465("plan", "own/short.toml", "-o", "own-plan.json", cwd=here)
    assert task_of_plan_file(Path("own-plan.json")) == Path("own/short.toml")
    shutil.rmtree(own)
    assert task_of_plan_file(Path("own-plan.json")) == Path("short.toml")  # who compares says what differs


def test_a_file_of_that_name_with_other_values_is_not_taken(here: Path) -> None:
    (here / "other").mkdir()
    (here / "other" / "short.toml").write_text("program = 3")
    replace_in(here / "short.toml", "clearance_mm = 6", "clearance_mm = 7")
    with pytest.raises(
        InputError, match=r"\(short.toml is not as it was when the plan was made; .*other/short.toml"
    ):
        task_of_plan_file(Path("plan.json"))
    replace_in(here / "short.toml", "clearance_mm = 7", "clearance_mm = 6.0  # the same value")
    assert task_of_plan_file(Path("plan.json")) == Path("short.toml")


def test_hidden_folders_and_links_are_left_out(here: Path, tmp_path: Path) -> None:
    shutil.copytree(here, tmp_path / "away")
    shutil.copytree(here, here / ".kept")
    (here / "short.toml").unlink()
    (here / "link").symlink_to(tmp_path / "away")
    with pytest.raises(InputError, match=r"there is no short\.toml here"):
        task_of_plan_file(Path("plan.json"))


@pytest.mark.parametrize("name", [None, "../short", "a/b", 3])
def test_a_plan_without_the_name_of_a_task(here: Path, name: object) -> None:
    plan = read_plan(here / "plan.json")
    write_plan(here / "odd.json", replace(plan, task={**plan.task, "name": name}))
    with pytest.raises(InputError, match=r"task.name.*must be the name of a task"):
        task_of_plan_file(Path("odd.json"))


def test_what_is_given_counts_and_an_arm_without_a_unit_needs_none(here: Path) -> None:
    plan = read_plan(here / "plan.json")
    assert task_or_none(here / "plan.json", plan, here / "x.toml") == here / "x.toml"
    other: Plan = replace(plan, unit=NO_UNIT)
    assert task_or_none(here / "plan.json", other, None) is None
