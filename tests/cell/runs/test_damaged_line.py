"""A line that damages what is sent, through the commands: stopped, told, gone on from; preloaded; without an echo."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import cell.commands.run
from arm.errors import ExecutionStopped, ImpossibleError
from cell.commands.run import execute_plan, resume_plan
from cell.console import Console
from cell.session.connection import WhichCell
from driver.emulator import EmulatorOptions
from typed.command_line import a465
from wire.lasting_cell import LastingCell
from wire.line_damage import Damage

pytestmark = pytest.mark.xdist_group("resume")


def execute(at: LastingCell, name: str, preload: bool = False) -> dict[str, Any]:
    where = WhichCell(at.url, preload=preload)
    return execute_plan(at.plan, at.file, Console(), where, at.folder / name)


@pytest.mark.slow
def test_after_a_damaged_line_the_run_stops_says_what_came_back_and_resume_finishes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    damage = Damage("digit", 1, seed=4)
    at = LastingCell(tmp_path, monkeypatch, "task2", to_unit=damage)

    def arm_it(name: str, part: float) -> bool:
        damage.armed |= ": to 03-04" in name and part >= 0.2
        return False

    with at.emulator:
        at.stop_at = arm_it
        with pytest.raises(ExecutionStopped, match="transmission error") as stopped:
            execute(at, "first")
        told = stopped.value
        assert damage.at_s is not None
        assert told.data["reason"] == "line"
        assert told.data["state"]["at_rest"]
        assert told.data["sent"].encode() == damage.line
        column = told.data["column"]
        assert told.data["sent"][: column - 1] == told.data["received"][: column - 1]
        assert told.data["sent"][column - 1] != told.data["received"][column - 1]
        for part in (
            repr(told.data["sent"]),
            repr(told.data["received"]),
            f"column {column}",
            "is in the jaws",
        ):
            assert part in str(told)
        assert len(at.held()) == 1
        said = capsys.readouterr().out
        assert f"to go on: a465 execute {told.data['resume_with']}" in said
        at.stop_at = None
        report = resume_plan(
            Path(told.data["resume_with"]), at.file, Console(), WhichCell(at.url), at.folder / "resumed"
        )
        assert "is in the jaws; its target is 03-04/" in capsys.readouterr().out
        assert all(c["placed"] for c in report["cubes"])
        assert max(c["error_mm"] for c in report["cubes"]) <= 1.0


@pytest.mark.slow
def test_a_unit_that_does_not_echo_is_told_of_and_cannot_be_preloaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    at = LastingCell(tmp_path, monkeypatch, "task2", EmulatorOptions(echo="none"))
    with at.emulator:
        with pytest.raises(ImpossibleError, match="preload: the unit does not echo"):
            execute(at, "preloaded", preload=True)
        assert len(at.emulator.record().time_ms) == 0  # nothing has moved
        capsys.readouterr()
        at.stopped(lambda: execute(at, "first"), "close on it", 0.0)
        assert capsys.readouterr().out.count("NO ECHO") == 1
        at.stopped(
            lambda: resume_plan(at.newest, at.file, Console(), WhichCell(at.url), at.folder / "second"),
            "",
            0.0,
        )
        assert capsys.readouterr().out.count("NO ECHO") == 1


@pytest.mark.slow
def test_preloaded_a_damaged_motion_is_sent_again_and_the_command_to_go_on_keeps_the_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    damage = Damage("bit", 20, seed=2, armed=True)
    at = LastingCell(tmp_path, monkeypatch, "task2", to_unit=damage)
    with at.emulator:
        at.stopped(lambda: execute(at, "first", preload=True), "close on it", 0.0)
        assert damage.at_s is not None
        said = capsys.readouterr().out
        assert said.count("the arm has not moved, so the motion is sent again") == 1
        assert "NO ECHO" not in said
        assert "--preload --resume" in said


@pytest.mark.parametrize(
    ("verb", "function"),
    [
        (("run", "scenes/task2.toml"), "run_task"),
        (("execute", "plan.json", "scenes/task2.toml"), "execute_plan"),
    ],
)
@pytest.mark.parametrize("preload", [False, True])
def test_the_option_reaches_the_run(
    monkeypatch: pytest.MonkeyPatch, verb: tuple[str, ...], function: str, preload: bool
) -> None:
    seen: list[WhichCell] = []

    def taken(*arguments: Any) -> dict[str, Any]:
        seen.extend(a for a in arguments if isinstance(a, WhichCell))
        return {"cubes": []}

    monkeypatch.setattr(cell.commands.run, function, taken)
    a465(*verb, *(["--preload"] if preload else []))
    assert [where.preload for where in seen] == [preload]
