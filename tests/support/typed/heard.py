"""A console that remembers."""

from __future__ import annotations

from cell.console import Console


class Heard(Console):
    """A console that remembers what was said."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[str] = []

    def say(self, text: str = "") -> None:
        self.told.append(text)

    @property
    def all(self) -> str:
        return "\n".join(self.told)
