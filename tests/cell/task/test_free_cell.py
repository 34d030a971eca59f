"""Before a real arm is homed, its cell is free."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import cell.session.homed
import cell.task.free_cell
from arm.errors import InputError
from cell.console import Console
from cell.task.free_cell import FreeCell


class _Asked:
    """Stands in for a person: gives answers in turn, and keeps what was asked."""

    def __init__(self, *answers: str | None) -> None:
        self.answers = list(answers)
        self.asked = 0

    def __call__(self) -> str | None:
        self.asked += 1
        return self.answers.pop(0)


def _run() -> Any:
    return SimpleNamespace(after_homing=lambda: None)


def test_homing_a_real_arm_asks_for_a_free_cell_and_then_for_the_boards(
    capsys: pytest.CaptureFixture[str],
) -> None:
    run, first = _run(), []
    person = _Asked("yes", " FREE ".strip(), "ready")
    FreeCell(first.append, "/dev/mars", False, Console(), person)(run)
    assert first == [run]  # the usual approval is asked too
    assert person.asked == 2
    told = capsys.readouterr().out
    assert "boards too" in told
    run.after_homing()
    assert person.asked == 3
    assert "put boards and cubes in place" in capsys.readouterr().out


@pytest.mark.parametrize("answers", [(None,), ("no", "n", "")])
def test_without_the_word_nothing_moves(answers: tuple[str | None, ...]) -> None:
    run = _run()
    with pytest.raises(InputError, match="'free' was not typed"):
        FreeCell(lambda run: None, "/dev/mars", False, Console(), _Asked(*answers))(run)


def test_nobody_to_ask_is_refused_and_says_what_programs_give(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cell.task.free_cell, "at_terminal", lambda: False)
    with pytest.raises(InputError, match="--free") as refused:
        FreeCell(lambda run: None, "/dev/mars", False, Console())(_run())
    assert "--homed" in str(refused.value)
    asked: list[Any] = []
    for port, said in (("/dev/mars", True), ("/dev/pts/3", False)):
        FreeCell(asked.append, port, said, Console())(_run())
    assert len(asked) == 2
