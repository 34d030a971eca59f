"""Before a plan moves a real arm a person has seen its preview, and is told what will move."""

from __future__ import annotations

import json
import os
import pty
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import cell.commands.run
import cell.session.dialogue
import cell.task.approval
from arm.controller.unit import load_unit
from arm.errors import InputError
from arm.io.storage import data_file
from arm.plan_file import Move, Plan, write_plan
from cell.config.cell_file import read_cell
from cell.console import Console
from cell.preview.content import page_content
from cell.session.dialogue import TRIES
from cell.session.overview import overview
from cell.task.approval import Approval, Consent
from driver.emulator import Emulator
from driver.execution.control import Control
from driver.line.clock import Clock
from driver.line.stepped_clock import SteppedClock
from driver.line.wire_log import WireLog
from driver.mars.mars import Mars
from typed.command_line import a465


def test_a_code_is_of_one_plan_alone_and_not_of_its_hash(preview_case) -> None:
    plan: Plan = preview_case.plan
    assert re.fullmatch(r"[2-9A-HJ-NP-Z]{4}-[2-9A-HJ-NP-Z]{4}", plan.code)
    assert replace(plan).code == plan.code
    others = {replace(plan, provenance={**plan.provenance, "seed": seed}).code for seed in range(1000, 1050)}
    assert len(others | {plan.code}) == 51


def test_the_preview_shows_the_code(preview_case) -> None:
    case = preview_case
    assert page_content(case.plan, case.robot_open, case.robot_holding, case.unit)["code"] == case.plan.code


@pytest.fixture
def plan(preview_case) -> Plan:
    """As a file may have it: what is called certified has a clearance for every segment."""
    steps = [replace(s, certified=False) if isinstance(s, Move) else s for s in preview_case.plan.steps]
    return replace(preview_case.plan, steps=tuple(steps))


@pytest.fixture
def plan_file(plan: Plan, tmp_path: Path) -> Path:
    write_plan(tmp_path / "plan.json", plan)
    return tmp_path / "plan.json"


@pytest.fixture
def run(preview_case, tmp_path: Path) -> Iterator[Any]:
    """What an approval looks at, with an emulated unit that was never homed."""
    unit, clock = preview_case.unit, SteppedClock()
    shipped = read_cell(data_file("scenes/cell.toml"))
    cell = SimpleNamespace(
        unit=unit,
        cube_size=0.04,
        robot_holding=lambda: preview_case.robot_holding,
        arm_shape=shipped.arm_shape,
        calibration=None,
        camera_file=shipped.camera_file,
        nominal_camera=shipped.nominal_camera,
    )
    with (
        Emulator(unit, clock) as emulator,
        WireLog(tmp_path / "wire.jsonl", clock) as wire,
        Mars(emulator.open_line(), unit, clock, wire) as mars,
    ):
        mars.identify()
        yield SimpleNamespace(
            task=SimpleNamespace(cell=cell),
            control=Control(ceiling=0.5),
            connection=SimpleNamespace(mars=mars, frames=None),
            wire=tmp_path / "wire.jsonl",
            homed_before=False,
        )


def sent(wire: Path) -> list[str]:
    records = map(json.loads, wire.read_text().splitlines())
    return [r["data"].strip() for r in records if r["kind"] == "sent"]


def test_what_will_move_is_told_and_nothing_but_questions_is_sent(
    plan_file: Path, plan: Plan, preview_case, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def answer() -> str:
        asked.append(capsys.readouterr().out)
        return f" {plan.code.replace('-', ' ').lower()} "

    Approval(plan_file, None, Console(), answer)(run, plan)
    (told,) = asked
    of = overview(plan, preview_case.robot_holding, preview_case.unit)
    assert f"{plan.duration_s / 0.5:.0f} s of motion" in told
    assert re.search("joint +lowest deg +highest deg +travel deg", told)
    assert "moves from where homing leaves it to the plan's start; this motion is not in the preview" in told
    assert "the joints turn by" not in told, "homing comes first, so it is not known how far"
    row = next(line.split() for line in told.splitlines() if line.startswith("J2"))
    assert row[1:4] == [f"{np.degrees(v[1]):.0f}" for v in (of.lowest, of.highest, of.travel)]
    assert not re.search(r"^J.*\s-0\s", told, re.MULTILINE)
    assert row[4] == f"{np.degrees(0.5 * of.fastest[1]):.1f}"
    limits = preview_case.unit.limits(plan.speed_registers).velocity
    assert row[5] == f"{50 * of.fastest[1] / limits[1]:.0f}"
    assert f"tool: at most {500 * of.tool:.0f} mm/s" in told
    assert "not homed since it was switched on, so its position is not known" in told
    assert "nobody has compared them with the arm; its links are padded by 10 mm" in told
    assert "NOT CALIBRATED: the camera's pose is that of lab.toml (the shipped placeholder)" in told
    assert "lens: PLACEHOLDER, as shipped" in told
    assert "without collision checks" in told
    assert plan.code not in told
    assert max(len(line) for line in told.splitlines() if re.match("joint|J[1-6]", line)) <= 80
    others = [
        line for line in sent(run.wire) if not re.fullmatch(r"|ECHO:[01]|STAMP:\d+|VER\?|AP[A-F]\?", line)
    ]
    assert others == []


def test_of_what_goes_on_nothing_is_said_to_be_homed(
    plan_file: Path, plan: Plan, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    Approval(plan_file, plan.code, Console(), resumes=True)(run, plan)
    told = capsys.readouterr().out
    assert "this moves the real arm on memory line: the rest of" in told
    assert "the arm will not be homed" in told
    assert "homes the arm" not in told
    assert "the plan's start" not in told


def test_the_page_that_is_named_is_that_of_the_plan(plan_file: Path, plan: Plan, tmp_path: Path) -> None:
    """A run that replanned has several; with the code of another it would be refused."""
    again = tmp_path / "plan-1.json"
    again.write_bytes(plan_file.read_bytes())
    (tmp_path / "preview.html").write_text("ABCD-EFGH")
    for page, told in (
        ("ABCD-EFGH", f"a465 preview {again} writes"),
        (plan.code, f"open {tmp_path}/preview-1.html"),
    ):
        (tmp_path / "preview-1.html").write_text(page)
        with pytest.raises(InputError, match=re.escape(told)):
            Approval(again, "wrong", Console())


def test_the_rest_of_a_plan_goes_on_unseen(
    plan_file: Path, plan: Plan, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """There is no terminal, and nobody has typed the code; a report is printed all the same."""
    with pytest.raises(InputError, match="no terminal to confirm"):
        Approval(plan_file, None, Console(), resumes=True)
    Approval(plan_file, None, Console(), resumes=True, unseen=True)(run, plan)
    assert "the rest of" in capsys.readouterr().out


def test_where_a_homed_arm_stands_is_told(
    plan_file: Path, plan: Plan, preview_case, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    run.connection.mars.initialise()
    Approval(plan_file, plan.code, Console())(run, plan)
    home = ", ".join(f"{d:.0f}" for d in np.degrees(preview_case.unit.soft_home))
    assert f"the arm: at [{home}] deg by its counters" in capsys.readouterr().out


def test_the_motion_to_the_start_of_the_plan_is_announced_with_how_far_each_joint_goes(
    plan_file: Path, plan: Plan, preview_case, run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    run.connection.mars.initialise()
    run.homed_before = True
    Approval(plan_file, plan.code, Console())(run, plan)
    far = np.degrees(preview_case.unit.positions(plan.start) - preview_case.unit.soft_home)
    assert np.abs(far).max() > 10.0, "a motion that is worth a word"
    told = capsys.readouterr().out
    assert "from its present configuration to the plan's start; this motion is not in the preview" in told
    assert "certified, or refused" in told
    shown = re.search(r"the joints turn by \[(.*)\] deg, further if it must go around something", told)
    assert shown is not None
    np.testing.assert_allclose([float(d) for d in shown[1].split(", ")], far, atol=0.6)


def test_a_joint_a_little_below_zero_is_told_without_a_sign() -> None:
    unit = load_unit("crs93")
    for degrees, told in ((-0.4, "0"), (0.4, "0"), (-0.6, "-1"), (0.6, "1")):
        counts = unit.counts(np.full(6, np.radians(degrees)))
        run: Any = SimpleNamespace(
            task=SimpleNamespace(cell=SimpleNamespace(unit=unit)),
            connection=SimpleNamespace(mars=SimpleNamespace(counters=lambda counts=counts: counts)),
        )
        assert f"at [{', '.join([told] * 6)}] deg by its counters" in cell.task.approval._place(run)


@pytest.mark.parametrize("typed", [["", "AAAA-AAAA", "2"], [None]])
def test_without_the_code_nothing_goes_on(
    plan_file: Path, plan: Plan, run: Any, typed: list[str | None]
) -> None:
    answers = iter(typed)
    approval = Approval(plan_file, None, Console(), lambda: next(answers))
    with pytest.raises(InputError, match="was not confirmed with the code of its preview; nothing moved"):
        approval(run, plan)
    assert next(answers, "none") == "none", f"asked {TRIES} times at most"


def test_a_wrong_code_is_told_before_a_port_is_opened(plan_file: Path, plan: Plan, tmp_path: Path) -> None:
    task = tmp_path / "none.toml"
    port = ("--port", tmp_path / "no-such-port")
    _, told = a465("execute", plan_file, task, *port, "--yes", "ABCD-EFGH", code=2)
    assert "--yes 'ABCD-EFGH': is not the code shown by the preview of" in told
    _, told = a465("execute", plan_file, task, "--yes", plan.code, code=2)
    assert "--yes needs --port" in told
    assert plan.code not in told


def test_plans_that_nobody_has_seen_move_a_real_arm_by_its_name_alone(
    run: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    run.speed = 0.1
    asked: list[str] = []

    def answer() -> str:
        asked.append(capsys.readouterr().out)
        return ("yes", run.task.cell.unit.name.upper())[len(asked) - 1]

    Consent(False, Console(), answer)(run)
    told = asked[0]
    assert (
        f"this moves the real arm on memory line, {run.task.cell.unit.name}, by plans made as the command runs"
        in told
    )
    assert "speed: 10 %" in told
    assert "NOT CALIBRATED: the camera's pose is that of lab.toml (the shipped placeholder)" in told
    assert "lens: PLACEHOLDER, as shipped" in told
    assert "without collision checks" in told
    assert f"that is not {run.task.cell.unit.name}; 2 more tries" in asked[1]
    Consent(True, Console())(run)
    assert "without a preview" in capsys.readouterr().out
    others = [
        line for line in sent(run.wire) if not re.fullmatch(r"|ECHO:[01]|STAMP:\d+|VER\?|AP[A-F]\?", line)
    ]
    assert others == []


def test_nobody_lets_the_arm_move_by_silence(run: Any) -> None:
    run.speed = 0.1
    for answer in (lambda: None, lambda: ""):
        with pytest.raises(InputError, match=f"{run.task.cell.unit.name!r} was not typed; nothing moved"):
            Consent(False, Console(), answer)(run)


def test_a_run_on_a_port_without_a_terminal_needs_to_be_told(tmp_path: Path) -> None:
    """With an emulated unit that is heard, and photographs that never come: it ends before any is waited for."""
    unit, clock = load_unit("crs93"), Clock(20.0)
    task = data_file("scenes/task2.toml")
    (tmp_path / "shots").mkdir()
    with Emulator(unit, clock) as emulator:
        _, told = a465(
            "run", task, "--port", emulator.open_pty(), "--images", tmp_path / "shots", code=2, cwd=tmp_path
        )
        assert "no terminal to confirm that a real arm may execute plans without a preview" in told
        assert "--unseen" in told
        moving = ("COORDMV", "COORDS", "HH", "GG:", "INIT")
        assert not any(line.startswith(moving) for _, line in emulator.lines)
    _, told = a465("run", task, "--unseen", code=2, cwd=tmp_path)
    assert "--unseen needs --port" in told
    _, told = a465("calibrate", "hand-eye", tmp_path / "r.json", "--unseen", code=2, cwd=tmp_path)
    assert "--unseen needs --collect" in told


def test_a_plan_that_was_changed_since_it_was_read_is_not_sent(plan_file: Path, plan: Plan, run: Any) -> None:
    other = replace(plan, provenance={**plan.provenance, "seed": 99})
    with pytest.raises(InputError, match="changed while it was being read"):
        Approval(plan_file, plan.code, Console())(run, other)
    asked: list[tuple[Any, Plan]] = []
    confirm = cell.commands.run._of_plan(lambda run, plan: asked.append((run, plan)), other)
    assert confirm is not None
    confirm(run)
    assert asked == [(run, other)], "asked about what is sent, not about what the file holds by then"


@pytest.mark.parametrize(
    ("before", "then"),
    [
        ("ls\ncrs93\n", "no\n"),  # pasted with other lines, before the question was there
        ("", "x" * 200 + "crs93\n"),
        ("", "crs93\x04\x04"),  # no line
        ("", "cr\u017f93\n"),
    ],
)
def test_only_a_whole_line_that_was_typed_after_the_question_answers_it(
    monkeypatch: pytest.MonkeyPatch, before: str, then: str
) -> None:
    master, slave = pty.openpty()
    with open(slave) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        os.write(master, before.encode())
        console = Console()
        monkeypatch.setattr(console, "say", lambda text: os.write(master, then.encode()))
        question = (console, "?", "crs93", cell.session.dialogue.typed, "nothing moved", "--unseen")
        with pytest.raises(InputError, match="'crs93' was not typed; nothing moved"):
            cell.session.dialogue.require_word(*question)
        monkeypatch.setattr(console, "say", lambda text: os.write(master, b"CRS93\n"))
        cell.session.dialogue.require_word(*question)
    os.close(master)


def test_an_interrupt_while_it_asks_sends_nothing(run: Any) -> None:
    mars = run.connection.mars
    before = len(sent(run.wire))
    error = cell.commands.run._interrupted(mars, False)
    assert "interrupted before the arm was allowed to move; nothing moved" in str(error)
    assert len(sent(run.wire)) == before
    cell.commands.run._interrupted(mars, True)
    assert "STOP:" in "".join(sent(run.wire)[before:])
