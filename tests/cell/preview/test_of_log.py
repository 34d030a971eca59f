"""The preview of a log, beside its plan or alone."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from arm.controller.unit import Unit
from arm.errors import ImpossibleError, InputError
from arm.io.storage import data_file
from arm.plan_file import Plan, write_plan
from cell.commands.preview import preview_file
from cell.console import Console
from cell.files.task import POSES
from cell.preview import of_log
from cell.preview.executed import plan_of
from cell.preview.of_log import preview_log
from driver.log.read import Session
from typed.heard import Heard
from wire.logged_session import LoggedRun

pytestmark = pytest.mark.xdist_group("logs")


def show(log: Path, page: Path, task: Path | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
    told = preview_log(log, task, page, Console(as_json=True))
    embedded = re.search(
        r'<script id="content" type="application/json">(.*?)</script>', page.read_text(), re.S
    )
    assert embedded is not None
    return told, json.loads(embedded[1])


def test_the_page_of_a_plan_beside_the_log(run: LoggedRun, plan: Plan, tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    log.write_bytes(run.log.read_bytes())
    write_plan(tmp_path / "plan.json", plan)
    (tmp_path / "report.json").write_text('{"format": 3}')
    (tmp_path / "torn.json").write_text('{"format": ')
    told, content = show(log, tmp_path / "log.html")
    assert told["plan_sha256"] == plan.sha256 == content["sha256"]
    assert (told["streams"], told["streams_shown"], told["task"]) == (2, 2, None)
    assert told["farthest_deg"] <= 0.02
    assert [e["step"] for e in content["executed"]] == [1, 4]
    assert content["motions"] == 2


def test_without_a_plan_the_arm_alone_is_shown(
    run: LoggedRun, session: Session, unit: Unit, tmp_path: Path
) -> None:
    log = tmp_path / "wire.jsonl"
    log.write_bytes(run.log.read_bytes())
    told, content = show(log, tmp_path / "log.html")
    assert told["plan"] is None
    made, matched = plan_of(session, unit)
    assert len(content["steps"]) == len(made.steps) == len(matched) >= 3
    assert content["motions"] == len(made.steps)  # each ends at rest
    assert {step["clearance"] for step in content["steps"]} == {None}
    assert content["bodies"] == content["boards"] == []
    assert told["farthest_deg"] <= 0.02


def test_a_task_that_cannot_be_shown_without_the_plan_is_told(run: LoggedRun, tmp_path: Path) -> None:
    log, task, page = shutil.copy(run.log, tmp_path), data_file("scenes/task2.toml"), tmp_path / "log.html"
    heard = Heard()
    preview_log(Path(log), task, page, heard)
    assert f"{task} is not shown: boards and camera need the plan of the log" in heard.all
    assert "give TASK to show them" not in heard.all
    with pytest.raises(InputError, match="is a camera file, and"):
        preview_log(Path(log), data_file("scenes/cameras/lab.toml"), page, heard)


def test_the_task_given_must_be_the_plans(run: LoggedRun, plan: Plan, tmp_path: Path) -> None:
    log = tmp_path / "wire.jsonl"
    log.write_bytes(run.log.read_bytes())
    write_plan(tmp_path / "plan.json", plan)
    with pytest.raises(ImpossibleError, match="the plan is for task no-such-task"):
        preview_log(log, data_file("scenes/task2.toml"), tmp_path / "log.html", Console(as_json=True))
    assert not (tmp_path / "log.html").exists()


def test_the_log_of_a_list_plan_is_shown_in_its_cell(
    run: LoggedRun, plan: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, cell, asked = tmp_path / "wire.jsonl", data_file("scenes/cell.toml"), []
    log.write_bytes(run.log.read_bytes())
    write_plan(tmp_path / "plan.json", plan)
    monkeypatch.setattr(of_log, "require_match", lambda task, plan: asked.append(task.kind))
    told, _ = show(log, tmp_path / "log.html", cell)
    assert told["task"] == str(cell)
    assert asked == [POSES]


def test_what_is_no_log_or_holds_no_motion_is_told(tmp_path: Path) -> None:
    path = tmp_path / "x.jsonl"
    path.write_text('{"t":0,"kind":"open"}\n{"t":0,"kind":"sent","data":"ANAXSETUPG:1,2\\n"}\n')
    with pytest.raises(InputError, match="has no motion with a known start"):
        preview_file(path, None, None, Console(as_json=True))
    path.write_text("nothing")
    with pytest.raises(InputError, match="is not JSON"):
        preview_file(path, None, None, Console(as_json=True))
    with pytest.raises(InputError, match="cannot be read"):
        preview_file(tmp_path / "none", None, None, Console(as_json=True))
