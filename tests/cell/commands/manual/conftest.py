"""A person at the terminal, and the built-in cell."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import cell.commands.manual.session
import cell.task.approval
from arm.io.storage import data_file
from cell.config.cell import Cell
from cell.config.cell_file import read_cell

CELL = data_file("scenes/cell.toml")
Answer = Callable[[], str | None]


@pytest.fixture(scope="session")
def here() -> Cell:
    return read_cell(CELL)


@pytest.fixture
def answers(monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], None]:
    """Let a function answer in place of a person."""

    def sits_there(answer: Answer) -> None:
        for module in (cell.commands.manual.session, cell.task.approval):
            monkeypatch.setattr(module, "at_terminal", lambda: True)
            monkeypatch.setattr(module, "typed", answer)

    return sits_there


@pytest.fixture
def abortable(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Someone at the keyboard; holds "aborts" while a key that is pressed would abort."""
    acting: list[str] = []

    @contextmanager
    def keys() -> Iterator[bool]:
        acting.append("aborts")
        yield True
        acting.clear()

    monkeypatch.setattr("cell.commands.run.aborting_keys", keys)
    return acting


@pytest.fixture(autouse=True)
def in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs leave their folders there."""
    monkeypatch.chdir(tmp_path)
