"""Homing asks that the cell is clear, and ends at q_start by a certified motion."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arm.errors import ExecutionStopped, ImpossibleError, InputError
from arm.plan_file import read_plan
from cell.commands.manual.home import home_step
from cell.config.cell import Cell
from cell.session.keyboard import ABORT_HELP
from driver.emulator import EmulatorOptions
from emulated.near_marks import near_marks
from emulated.stepped_cell import names_sent, stepped_cell
from typed.command_line import a465
from typed.heard import Heard

from .conftest import CELL

QUERIES = {"ECHO", "STAMP", "VER?", "ST?", *(f"AP{axis}?" for axis in "ABCDEFGH")}


def _sent_before_the_first_motion(names: list[str]) -> set[str]:
    return set(names[: next(i for i, name in enumerate(names) if name.startswith("HH"))])


def test_a_real_arm_is_homed_once_a_person_has_cleared_the_cell(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    options, console, asked = EmulatorOptions(power_up_deg=near_marks(here.unit)), Heard(), []
    with stepped_cell(here, monkeypatch, options=options) as emulator:

        def answer() -> str:
            asked.append((console.all, set(names_sent(emulator))))
            return "free"

        answers(answer)
        report = home_step(CELL, "/dev/mars", 1.0, False, console)
        np.testing.assert_allclose(np.degrees(here.q_start), report["q_deg"], atol=0.01)
        np.testing.assert_array_equal(emulator.counts(), here.unit.counts(here.q_start))
        assert emulator.violations == ()
    ((told, sent),) = asked
    assert "homing has no collision checks: remove everything" in told
    assert sent <= QUERIES
    plan = read_plan(Path("runs/home-1/to-start.json"))
    assert all(move.certified for move in plan.moves)
    assert plan.speed == 1.0
    assert json.loads(Path("runs/home-1/report.json").read_text())["kind"] == "poses"


def test_without_the_word_the_unit_gets_queries_only(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    answers(lambda: "ready")
    with stepped_cell(here, monkeypatch) as emulator:
        with pytest.raises(InputError, match="'free' was not typed; nothing moved"):
            home_step(CELL, "/dev/mars", None, False, Heard())
        assert set(names_sent(emulator)) <= QUERIES


def test_while_the_arm_homes_a_key_aborts(
    here: Cell, monkeypatch: pytest.MonkeyPatch, abortable: list[str]
) -> None:
    console, during = Heard(), []

    def homes(*_: object) -> None:
        during.extend(abortable)
        raise ExecutionStopped("that is enough")

    monkeypatch.setattr("cell.task.run.TaskRun.initialise_arm", homes)
    with stepped_cell(here, monkeypatch), pytest.raises(ExecutionStopped, match="that is enough"):
        home_step(CELL, "/dev/mars", None, True, console)
    assert during == ["aborts"]
    assert ABORT_HELP in console.all


def test_an_arm_that_was_homed_and_cannot_go_on_has_moved(
    here: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 3 says that nothing moved."""

    def none(*_: object) -> None:
        raise ImpossibleError("link 3 comes within 2 mm of a wall", pair=["link 3", "wall"])

    monkeypatch.setattr("cell.task.run.TaskRun.go_to_start", none)
    options = EmulatorOptions(power_up_deg=near_marks(here.unit))
    with stepped_cell(here, monkeypatch, options=options) as emulator:
        with pytest.raises(
            ExecutionStopped, match=r"homed, and the arm stands at its marks: .* of a wall"
        ) as told:
            home_step(CELL, "/dev/mars", 1.0, True, Heard())
        assert any(name.startswith("HH") for name in names_sent(emulator))
    assert told.value.data["pair"] == ["link 3", "wall"]


def test_an_axis_error_is_told_before_the_question_whose_answer_clears_it(
    here: Cell, monkeypatch: pytest.MonkeyPatch, answers: Callable[..., None]
) -> None:
    console = Heard()
    answers(lambda: "no")
    with stepped_cell(here, monkeypatch) as emulator:
        emulator.fail_axis("C")
        with pytest.raises(InputError, match="'free' was not typed"):
            home_step(CELL, "/dev/mars", None, False, console)
    assert "AN AXIS IS IN ERROR" in console.all
    assert console.all.index("AN AXIS IS IN ERROR") < console.all.index("type free")


def test_nobody_to_ask_is_refused_before_a_port_is_opened(tmp_path: Path) -> None:
    _, told = a465("home", CELL, "/dev/null", code=2)
    assert "no terminal to confirm that the cell is clear for homing" in told
    assert "--free" in told
    assert list(tmp_path.iterdir()) == []


def test_a_fault_is_refused_and_nothing_is_homed(here: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    with stepped_cell(here, monkeypatch) as emulator:
        emulator.set_motion_stop(True)
        with pytest.raises(ImpossibleError, match="motion stop is pressed"):
            home_step(CELL, "/dev/mars", None, True, Heard())
        assert not any(name.startswith("HH") for name in names_sent(emulator))


@pytest.mark.parametrize("speed", ["0", "1.5"])
def test_a_speed_that_cannot_be_is_refused(speed: str) -> None:
    _, told = a465("home", CELL, "/dev/none-such", "--free", "--speed", speed, code=2)
    assert f"--speed {speed}: must be from 0.01 to 1" in told
