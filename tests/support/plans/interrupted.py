"""Searches that are stopped as soon as they have a complete plan."""

from __future__ import annotations

import pytest

from plan.program.assignment import search as sequence
from plan.program.assignment.sequencing import best_order


def stop_when_complete(monkeypatch: pytest.MonkeyPatch, stop: BaseException) -> None:
    """Ctrl-C, or a budget's end, as soon as a first sequence is complete."""
    proved, asked = sequence.TaskSearch._checked, best_order
    found: list[object] = []

    def noted(self: sequence.TaskSearch, *more: object) -> object:
        result = proved(self, *more)  # type: ignore[arg-type]
        found.extend([] if result is None else [result])
        return result

    def pressed(*more: object) -> object:
        if found:
            raise stop
        return asked(*more)  # type: ignore[arg-type]

    monkeypatch.setattr(sequence.TaskSearch, "_checked", noted)
    monkeypatch.setattr(sequence, "best_order", pressed)
